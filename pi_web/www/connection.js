// The Foxglove WebSocket protocol, as far as the page needs it. Connects again by itself.
import {Decoder} from './rosmsg.js';

const PROTOCOLS = ['foxglove.sdk.v1', 'foxglove.websocket.v1'];
const AGAIN_MS = 1000;
const SILENT_MS = 5000;  // of a network that is gone without a word: the browser would wait for minutes

export class Connection {
  // handlers: onState(connected, text), onControl(allowed), onStatus(text)
  constructor(url, handlers) {
    this.url = url;
    this.handlers = handlers;
    this.wanted = new Map();    // topic -> callback(message, topic, when it came to the server [s])
    this.outgoing = new Map();  // topic -> {type, id}
    this.calls = new Map();
    this.last = 0;
    this.connect();
    setInterval(() => this.watch(), 1000);
  }

  subscribe(topic, callback) {
    this.wanted.set(topic, callback);
    const channel = this.topics && this.topics.get(topic);
    if (channel) this.open(channel);
  }

  unsubscribe(topic) {
    this.wanted.delete(topic);
    for (const [id, channel] of this.channels) {
      if (channel.topic === topic && channel.open) {
        channel.open = false;
        this.send({op: 'unsubscribe', subscriptionIds: [id]});
      }
    }
  }

  has(topic) { return Boolean(this.topics && this.topics.has(topic)); }

  // Topics of these types that exist.
  topicsOf(...types) {
    return [...(this.topics || new Map()).values()].filter((one) => types.includes(one.schemaName))
      .map((one) => one.topic).sort();
  }

  publishes(topic, type) {
    this.outgoing.set(topic, {type, id: this.outgoing.size + 1});
  }

  publish(topic, bytes) {
    const {id} = this.outgoing.get(topic);
    const message = new Uint8Array(5 + bytes.length);
    const view = new DataView(message.buffer);
    view.setUint8(0, 1);
    view.setUint32(1, id, true);
    message.set(bytes, 5);
    this.socket.send(message);
  }

  // Asks once per connection. callback([{name, value}])
  parameters(names, callback) {
    this.asked = {names, callback};
  }

  hasService(name) { return Boolean(this.services && this.services.has(name)); }

  // A std_srvs/Trigger. Resolves to {success, message}; rejects if the service fails or the connection ends.
  call(name) {
    const service = this.services && this.services.get(name);
    if (!service || !this.control) return Promise.reject(new Error(`${name} is not there`));
    const id = ++this.last;
    const message = new DataView(new ArrayBuffer(17));
    message.setUint8(0, 2);
    message.setUint32(1, service.id, true);
    message.setUint32(5, id, true);
    message.setUint32(9, 4, true);
    [...'ros1'].forEach((c, i) => message.setUint8(13 + i, c.charCodeAt(0)));
    return new Promise((resolve, reject) => {
      this.calls.set(id, {resolve, reject, decoder: new Decoder(service.responseSchema)});
      this.socket.send(message.buffer);
    });
  }

  connect() {
    this.channels = new Map();  // by id, which is also that of the subscription
    this.topics = new Map();
    this.services = new Map();
    this.control = false;
    this.heard = Date.now();
    const socket = new WebSocket(this.url, PROTOCOLS);
    this.socket = socket;
    socket.binaryType = 'arraybuffer';
    socket.onmessage = (event) => {
      if (socket !== this.socket) return;
      this.heard = Date.now();
      if (typeof event.data === 'string') this.onText(JSON.parse(event.data));
      else this.onBinary(new DataView(event.data));
    };
    socket.onclose = () => {
      if (socket === this.socket) this.lost('no connection to the vehicle');
    };
  }

  lost(text) {
    this.socket.onclose = null;
    this.socket.close();
    this.socket = {send() {}, close() {}};
    for (const {reject} of this.calls.values()) reject(new Error('the connection ended'));
    this.calls.clear();
    this.control = false;
    this.handlers.onControl(false);
    this.handlers.onState(false, text);
    setTimeout(() => this.connect(), AGAIN_MS);
  }

  // A vehicle that says nothing is asked for something small, and given up if it still says nothing.
  watch() {
    if (this.socket.readyState !== WebSocket.OPEN) return;
    const silent = Date.now() - this.heard;
    if (silent > SILENT_MS) this.lost('the vehicle does not answer');
    else if (silent > SILENT_MS / 2) this.send({op: 'getParameters', parameterNames: ['/run_id'], id: 'alive'});
  }

  send(object) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(object));
  }

  open(channel) {
    if (channel.open) return;
    try {
      channel.decoder = channel.decoder || new Decoder(channel.schema);
    } catch (error) {
      this.handlers.onStatus(`${channel.topic} is not shown: ${error.message}`);
      return;
    }
    channel.open = true;
    this.send({op: 'subscribe', subscriptions: [{id: channel.id, channelId: channel.id}]});
  }

  onText(message) {
    if (message.op === 'serverInfo') {
      this.control = message.capabilities.includes('clientPublish');
      if (this.control && this.outgoing.size) {
        this.send({op: 'advertise', channels: [...this.outgoing].map(([topic, {type, id}]) => (
          {id, topic, encoding: 'ros1', schemaName: type}))});
      }
      if (this.asked) this.send({op: 'getParameters', parameterNames: this.asked.names, id: 'asked'});
      this.handlers.onState(true, '');
      this.handlers.onControl(this.control);
    } else if (message.op === 'advertise') {
      for (const channel of message.channels) {
        this.channels.set(channel.id, channel);
        this.topics.set(channel.topic, channel);
        if (this.wanted.has(channel.topic)) this.open(channel);
      }
      if (this.handlers.onTopics) this.handlers.onTopics();
    } else if (message.op === 'unadvertise') {
      for (const id of message.channelIds) {
        const channel = this.channels.get(id);
        if (channel && this.topics.get(channel.topic) === channel) this.topics.delete(channel.topic);
        this.channels.delete(id);
      }
      if (this.handlers.onTopics) this.handlers.onTopics();
    } else if (message.op === 'advertiseServices') {
      for (const service of message.services) this.services.set(service.name, service);
      this.handlers.onControl(this.control);
    } else if (message.op === 'unadvertiseServices') {
      for (const [name, {id}] of this.services) if (message.serviceIds.includes(id)) this.services.delete(name);
      this.handlers.onControl(this.control);
    } else if (message.op === 'serviceCallFailure') {
      this.settle(message.callId, (call) => call.reject(new Error(message.message)));
    } else if (message.op === 'parameterValues' && message.id === 'asked') {
      this.asked.callback(message.parameters);
    } else if (message.op === 'status' && message.level > 0) {
      this.handlers.onStatus(message.message);
    }
  }

  settle(id, how) {
    const call = this.calls.get(id);
    this.calls.delete(id);
    if (call) how(call);
  }

  onBinary(view) {
    const opcode = view.getUint8(0);
    if (opcode === 1) {
      const channel = this.channels.get(view.getUint32(1, true));
      if (!channel || !channel.open) return;
      const callback = this.wanted.get(channel.topic);
      const stamp = Number(view.getBigUint64(5, true)) * 1e-9;
      if (callback) callback(channel.decoder.decode(new DataView(view.buffer, 13)), channel.topic, stamp);
    } else if (opcode === 3) {
      const start = 13 + view.getUint32(9, true);
      this.settle(view.getUint32(5, true),
        (call) => call.resolve(call.decoder.decode(new DataView(view.buffer, start))));
    }
  }
}
