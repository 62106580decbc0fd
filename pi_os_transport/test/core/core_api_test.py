#!/usr/bin/python3 -B
"""Judge of core_api.test."""
import os
import pathlib
import sys
import xmlrpc.client

import rosgraph

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import core_harness  # noqa: E402  (found through the line above)
import transport_harness as harness  # noqa: E402

NODE = '/ns/node'


class Recorder:
    """One master with two nodes that remember what they are told; results with the nodes' URIs written by name."""

    def __init__(self, uri, first, second):
        self.uri = uri
        self.proxy = xmlrpc.client.ServerProxy(uri)
        self.first, self.second = first, second

    def named(self, value):
        """The value, with lists of names in an order of their own: that of masters is not defined."""
        if isinstance(value, str):
            for uri, name in ((self.first.uri, 'http://first/'), (self.second.uri, 'http://second/'),
                              (self.uri, 'http://master/')):
                value = value.replace(uri, name)
            return value
        if isinstance(value, (list, tuple)):
            return [self.named(one) for one in value]
        if isinstance(value, dict):
            return {key: self.named(one) for key, one in value.items()}
        if isinstance(value, (xmlrpc.client.Binary, xmlrpc.client.DateTime)):
            return str(value)
        return value

    def call(self, method, *params):
        uris = {'FIRST': self.first.uri, 'SECOND': self.second.uri}
        params = [uris.get(param, param) if isinstance(param, str) else param for param in params]
        try:
            code, message, value = getattr(self.proxy, method)(*params)
        except xmlrpc.client.Fault as fault:
            return 'fault', fault.faultCode, fault.faultString.replace("<class 'Exception'>:", '')
        value = self.named(value)
        if method in ('getSystemState',):
            value = [sorted(part) for part in value]
        elif method in ('getTopicTypes', 'getPublishedTopics', 'getParamNames') and isinstance(value, list):
            value = sorted(value)
        return code, self.named(message), value


class CoreApi(core_harness.CoreTest):

    def setUp(self):
        super().setUp()
        stock = rosgraph.get_master_uri()  # rostest's own master
        self.recorders = [Recorder(uri, self.slave(), self.slave())
                          for uri in (stock if stock.endswith('/') else stock + '/', self.core('pi_master').uri)]
        self.assertIn('python', self.program_of(self.recorders[0]))
        self.assertIn('pi_master', self.program_of(self.recorders[1]))
        self.clear()
        self.addCleanup(self.clear)

    @staticmethod
    def program_of(recorder):
        return os.readlink('/proc/%d/exe' % recorder.proxy.getPid('/judge')[2])

    def clear(self):
        """rostest's master is the same in all tests."""
        for recorder in self.recorders:
            for key in ('/p', '/ns', '/deep', '/typed', '/q'):
                recorder.proxy.deleteParam('/judge', key)

    def same(self, method, *params):
        stock, ours = [recorder.call(method, *params) for recorder in self.recorders]
        self.assertEqual(ours, stock, '%s%r' % (method, params))
        return ours

    def same_told(self, first, second):
        """Both masters have told the nodes this."""
        for recorder in self.recorders:
            recorder.first.await_told([tuple(recorder_values(recorder, one)) for one in first])
            recorder.second.await_told([tuple(recorder_values(recorder, one)) for one in second])

    def test_registrations(self):
        self.same('registerSubscriber', NODE, 't', 'std_msgs/String', 'FIRST')
        told = []
        for _ in range(2):
            self.same('registerPublisher', '/pub', '/ns/t', 'std_msgs/String', 'SECOND')
            # pi_master leaves out an update that waits for a slow node once there is a newer one.
            told.append(('publisherUpdate', '/ns/t', ['SECOND']))
            self.same_told(told, [])
        self.same('registerPublisher', '/pub', '~private', '*', 'SECOND')
        self.same('registerService', '/pub', 's', 'rosrpc://host:1', 'SECOND')
        self.same('lookupService', NODE, '/s')
        self.same('lookupNode', NODE, '/pub')
        self.same('lookupNode', NODE, '/nobody')
        for subgraph in ('', '/ns', 'ns/', '/nothing'):
            with self.subTest(subgraph):
                ours, stock = [[topic for topic in recorder.call('getPublishedTopics', '/x', subgraph)[2]
                                if 'rosout' not in topic[0]] for recorder in self.recorders]
                self.assertEqual(ours, stock)
        self.same('registerService', NODE, '/s', 'rosrpc://other:2', 'FIRST')
        self.same('unregisterService', '/pub', '/s', 'rosrpc://host:1')
        self.same('unregisterService', NODE, '/s', 'rosrpc://other:2')
        self.same('unregisterService', NODE, '/s', 'rosrpc://other:2')
        self.same('lookupService', NODE, '/s')
        self.same('unregisterSubscriber', NODE, '/ns/t', 'SECOND')
        self.same('unregisterPublisher', '/pub', '/ns/t', 'SECOND')
        self.same('unregisterPublisher', '/pub', '/ns/t', 'SECOND')
        self.same('unregisterPublisher', '/pub', '/pub/private', 'SECOND')
        self.same('unregisterPublisher', '/pub', '/pub/private', 'SECOND')
        self.same('unregisterSubscriber', NODE, 't', 'FIRST')
        self.same('lookupNode', NODE, '/pub')
        self.same_told(told + [('publisherUpdate', '/ns/t', [])], [])

    def test_a_node_of_the_same_name_takes_over(self):
        self.same('registerPublisher', NODE, '/a', 'std_msgs/String', 'FIRST')
        self.same('registerSubscriber', NODE, '/b', 'std_msgs/String', 'FIRST')
        self.same('registerService', NODE, '/c', 'rosrpc://host:1', 'FIRST')
        self.same('subscribeParam', NODE, 'FIRST', '/p')
        self.same('registerPublisher', NODE, '/d', 'std_msgs/String', 'SECOND')
        self.same('lookupNode', NODE, NODE)
        self.same('lookupService', NODE, '/c')
        self.same('setParam', '/judge', '/p', 1)
        self.same_told([('shutdown', '[/ns/node] Reason: new node registered with same name')], [])
        self.same('unregisterPublisher', NODE, '/a', 'FIRST')
        self.same('unregisterPublisher', NODE, '/d', 'SECOND')

    def test_parameters(self):
        typed = {'int': -7, 'bool': True, 'double': 1.0 / 3.0, 'text': 'ä<&>"\' \n', 'empty': '', 'list': [1, [], {}],
                 'binary': xmlrpc.client.Binary(b'\0\xff'), 'time': xmlrpc.client.DateTime('20261123T10:00:00'),
                 'tree': {'a': {'b': [1.5, 'x', False]}}}
        self.same('setParam', NODE, '/typed', typed)
        for key in ('/typed', '/typed/tree/a/b', '/typed//list/', '/typed/int/none', 'typed', '/'):
            if key != '/':  # rostest has parameters of its own
                self.same('getParam', NODE, key)
            self.same('hasParam', NODE, key)
        self.same('setParam', NODE, 'rel', 1)
        self.same('setParam', NODE, '~own', 2)
        self.same('getParam', NODE, '/ns')
        self.same('setParam', NODE, '/ns/rel/below', {'x': {}})
        self.same('getParam', NODE, '/ns')
        for key in ('rel', 'own', 'node', 'rel/other', '/ns/rel', '~own', 'nothing', '/nothing'):
            self.same('searchParam', NODE, key)
            self.same('searchParam', NODE + '/deeper', key)
        self.same('searchParam', 'no_slash', 'rel')
        self.same('setParam', NODE, '/', 5)
        self.same('deleteParam', NODE, '/')
        self.same('deleteParam', NODE, 'rel/nothing')
        self.same('deleteParam', NODE, 'rel')
        self.same('deleteParam', NODE, 'rel')
        self.same('getParam', NODE, 'rel')

    def test_parameter_callbacks(self):
        self.same('subscribeParam', NODE, 'FIRST', '/p')
        self.same('subscribeParam', '/second', 'SECOND', '/p/a/b')
        self.same('setParam', NODE, '/p/a', {'b': 1, 'c': 2})   # not told to who sets it
        self.same_told([], [('paramUpdate', '/p/a/b/', 1)])
        self.same('setParam', '/judge', '/p/a/b', 5)
        self.same_told([('paramUpdate', '/p/a/b/', 5)],
                       [('paramUpdate', '/p/a/b/', 1), ('paramUpdate', '/p/a/b/', 5)])
        self.same('setParam', '/judge', '/p', {'x': 1})
        self.same_told([('paramUpdate', '/p/a/b/', 5), ('paramUpdate', '/p/', {'x': 1})],
                       [('paramUpdate', '/p/a/b/', 1), ('paramUpdate', '/p/a/b/', 5), ('paramUpdate', '/p/a/b/', {})])
        self.same('unsubscribeParam', '/second', 'SECOND', '/p/a/b')
        self.same('unsubscribeParam', '/second', 'SECOND', '/p/a/b')
        self.same('deleteParam', '/judge', '/p/x')
        self.same('subscribeParam', '/second', 'SECOND', '/p')
        self.same('unsubscribeParam', NODE, 'FIRST', '/p')
        self.same('unsubscribeParam', '/second', 'SECOND', '/p')

    def test_improper_calls(self):
        improper = ['', 0, 5, [], ['x'], {}, {'x': 1}, 1.5, True, 'a b', 'a:b', '/', 'http://x', 'x']
        for method, count in (('getPid', 0), ('getUri', 0), ('getParam', 1), ('hasParam', 1), ('searchParam', 1),
                              ('deleteParam', 1), ('lookupNode', 1), ('lookupService', 1), ('getPublishedTopics', 1)):
            if count == 1:
                for value in improper:
                    if (method, value) != ('getPublishedTopics', '/') and (method, value) != ('getParam', '/'):
                        self.same(method, NODE, value)
            self.same(method)
            self.same(method, 5, *['x'] * count)
            self.same(method, NODE, *['x'] * (count + 1))
        for value in improper:
            self.same('registerPublisher', NODE, value, 'a/B', 'bad')
            self.same('registerSubscriber', NODE, 't', value, 'bad')
            self.same('registerService', NODE, 's', value, 'bad')
            self.same('unregisterPublisher', NODE, 't', value)
            self.same('unregisterService', NODE, value, 'rosrpc://x')
            self.same('subscribeParam', NODE, 'http://x', [value])
            self.same('unsubscribeParam', NODE, value, 'x')
        self.same('setParam', NODE, '', 1)
        self.same('noSuchMethod', NODE)
        self.same('_shutdown', NODE)

    def test_many_calls_at_a_time(self):
        answers = []
        for recorder in self.recorders:
            many = xmlrpc.client.MultiCall(recorder.proxy)
            many.setParam(NODE, '/q/a', 1)
            many.getParam(NODE, '/q')
            many.getParam(NODE, '/q/none')
            answers.append([list(answer) for answer in many()])
        self.assertEqual(answers[1], answers[0])
        self.assertEqual(answers[0][1], [1, 'Parameter [/q]', {'a': 1}])


def recorder_values(recorder, told):
    """What a node is told, with the URIs of this master's nodes."""
    uris = {'FIRST': recorder.first.uri, 'SECOND': recorder.second.uri}
    return [[uris.get(value, value) for value in one] if isinstance(one, list) else one for one in told]


if __name__ == '__main__':
    harness.main(CoreApi)
