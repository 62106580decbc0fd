"""The states of processes as tables."""

BUCKET_NS = 1024.0   # bucket 0 of a histogram ends here, each further one at twice the end of the one before


def quantile_us(counts, quantile):
    """Upper end of the bucket in which a quantile of a histogram lies [us]; None without any count."""
    total = sum(counts)
    if total == 0:
        return None
    seen = 0
    for bucket, count in enumerate(counts):
        seen += count
        if seen >= quantile * total:
            return BUCKET_NS * 2 ** bucket / 1000.0
    return None


def format_us(value):
    if value is None:
        return '-'
    for unit, factor in (('us', 1.0), ('ms', 1e3)):
        if value < 1000 * factor:
            return '%.3g %s' % (value / factor, unit)
    return '%.3g s' % (value / 1e6)


def format_latency(counts):
    """Upper bounds of p50, p99 and the longest."""
    return '/'.join(format_us(quantile_us(counts, quantile)) for quantile in (0.5, 0.99, 1.0))


def joined_links(states):
    """One entry for each link that at least one process has told of: both ends' counters in one place."""
    links = {}
    for state in states:
        for entry in state['publications']:
            key = entry['topic'], state['node'], entry['subscriber']
            links.setdefault(key, {})['out'] = entry
        for entry in state['subscriptions']:
            key = entry['topic'], entry['publisher'], state['node']
            links.setdefault(key, {})['in'] = entry
    found = []
    for (topic, publisher, subscriber), ends in sorted(links.items()):
        out, into = ends.get('out', {}), ends.get('in', {})
        found.append({'topic': topic, 'publisher': publisher, 'subscriber': subscriber,
                      'transport': into.get('transport') or out.get('transport'),
                      'memory': max(out.get('memory', 0), into.get('memory', 0)),
                      'tcp': max(out.get('tcp', 0), into.get('tcp', 0)),
                      'waiting': out.get('waiting', into.get('waiting', 0)), 'queue_size': out.get('queue_size', 0),
                      'dropped': out.get('dropped', into.get('missing', 0)), 'pool_full': out.get('pool_full', 0),
                      'copied': into.get('copied', 0),
                      'latencies': into.get('latencies', []),
                      'reason': into.get('reason') or out.get('reason') or '',
                      'reason_publisher': out.get('reason', ''), 'reason_subscriber': into.get('reason', '')})
    return found


def link_rows(links):
    return (['topic', 'publisher', 'subscriber', 'transport', 'memory', 'tcp', 'waiting', 'dropped', 'pool full',
             'latency p50/p99/max', 'reason'],
            [[link['topic'], link['publisher'], link['subscriber'], link['transport'], link['memory'], link['tcp'],
              link['waiting'], link['dropped'], link['pool_full'], format_latency(link['latencies']),
              link['reason'] or '-'] for link in links])


def service_rows(states):
    rows = []
    for side, table in (('client', 'service_clients'), ('server', 'service_servers')):
        for state in states:
            for entry in state[table]:
                rows.append([entry['service'], side, state['node'], entry['connections'], entry['memory'],
                             entry['tcp'], entry['failed'], entry['pool_full'], format_latency(entry['durations']),
                             entry['reason'] or '-'])
    return (['service', 'side', 'node', 'connections', 'memory', 'tcp', 'failed', 'pool full', 'time p50/p99/max',
             'reason'], sorted(rows))


def node_rows(states):
    rows = []
    for state in states:
        pool, descriptors = state['pool'], state['descriptors']
        rows.append([state['node'], state['pid'], '%d of %d' % (descriptors['open'], descriptors['limit']),
                     '%.1f of %.0f' % (pool['committed'] / 2.0 ** 20, pool['limit'] / 2.0 ** 20),
                     pool['segments'], pool['live_slots'], len(state['publications']), len(state['subscriptions'])])
    return (['node', 'pid', 'descriptors', 'pool [MiB]', 'segments', 'messages held', 'links out', 'links in'], rows)
