// A recording in place of the connection: the same calls, and a time that one may choose.
import {readBag} from './bag.js';
import {setClock} from './clock.js';
import {Decoder} from './rosmsg.js';

const BEFORE = new Map([['/tf', 20], ['/tf_static', Infinity]]);  // messages before a moment that tell its state
const FREQUENT_S = 0.1;  // between two messages of a topic that is subscribed as TOPIC/web

export class Playback {
  // handlers: onState(connected, text), onControl(allowed), onTopics(), onReset(), onTime(time, begin, end, playing)
  constructor(url, handlers) {
    this.handlers = handlers;
    this.wanted = new Map();  // topic of the bag -> {callback, least time between two, last}
    this.topics = new Map();
    this.playing = false;
    this.load(url);
  }

  async load(url) {
    try {
      const answer = await fetch(url);
      if (!answer.ok) throw new Error((await answer.text()).trim() || answer.statusText);
      const {connections, messages} = readBag(await answer.arrayBuffer());
      if (!messages.length) throw new Error('it holds no message');
      this.messages = messages;
      for (const one of connections) this.topics.set(one.topic, one);
      [this.begin, this.end] = [messages[0].time, messages[messages.length - 1].time];
    } catch (error) {
      this.handlers.onState(false, `${url.split('?')[0]} is not shown: ${error.message}`);
      return;
    }
    setClock(() => this.time * 1000);
    this.handlers.onState(true, '');
    this.handlers.onControl(false);
    this.seek(this.begin);
    this.handlers.onTopics();
    this.play(true);
  }

  subscribe(topic, callback) {
    const thinned = topic.endsWith('/web');
    this.wanted.set(topic.replace(/\/web$/, ''), {callback, least: thinned ? FREQUENT_S : 0, last: -Infinity});
    if (this.messages) this.seek(this.time);
  }

  unsubscribe(topic) { this.wanted.delete(topic.replace(/\/web$/, '')); }

  topicsOf(...types) {
    return [...this.topics.values()].filter((one) => types.includes(one.type)).map((one) => one.topic).sort();
  }

  // A recording takes no commands and knows no parameters.
  publishes() {}

  parameters() {}

  hasService() { return false; }

  // Shows the state at a time [s].
  seek(time) {
    this.time = Math.min(this.end, Math.max(this.begin, time));
    this.next = this.after(this.time);
    this.handlers.onReset();
    const left = new Map([...this.wanted.keys()].map((topic) => [topic, BEFORE.get(topic) || 1]));
    const shown = [];
    for (let i = this.next - 1; i >= 0 && left.size; --i) {
      const {topic} = this.messages[i].connection;
      if (!left.has(topic)) continue;
      shown.push(this.messages[i]);
      if (left.get(topic) > 1) left.set(topic, left.get(topic) - 1);
      else left.delete(topic);
    }
    for (const one of this.wanted.values()) one.last = -Infinity;
    for (const message of shown.reverse()) this.deliver(message);
    this.tell();
  }

  play(on) {
    if (on && this.time >= this.end) this.seek(this.begin);
    this.playing = on;
    this.tell();
    if (!on) return;
    const [start, from] = [performance.now(), this.time];
    const turn = (this.turn || 0) + 1;
    this.turn = turn;
    const frame = () => {
      if (!this.playing || this.turn !== turn) return;
      this.time = Math.min(this.end, from + (performance.now() - start) / 1000);
      while (this.next < this.messages.length && this.messages[this.next].time <= this.time) {
        this.deliver(this.messages[this.next++]);
      }
      this.playing = this.time < this.end;
      this.tell();
      requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  }

  tell() { this.handlers.onTime(this.time, this.begin, this.end, this.playing); }

  // Index of the first message after a time.
  after(time) {
    let [low, high] = [0, this.messages.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.messages[middle].time <= time) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  deliver({time, connection, view}) {
    const wanted = this.wanted.get(connection.topic);
    if (!wanted || (time - wanted.last < wanted.least && !BEFORE.has(connection.topic))) return;
    wanted.last = time;
    connection.decoder = connection.decoder || new Decoder(connection.definition);
    wanted.callback(connection.decoder.decode(view), connection.topic, time);
  }
}
