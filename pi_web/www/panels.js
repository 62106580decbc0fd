// State, health, services, latency and incidents, in words and figures.

import {now} from './clock.js';

const MODES = ['ready', 'driving', 'stopped by the watchdog', 'emergency stop', 'fault', 'disconnected'];
const LEVELS = ['', 'warn', 'bad', 'bad'];  // of diagnostic_msgs/DiagnosticStatus: OK, WARN, ERROR, STALE
const MOST_COMPLAINTS = 8;
const MOST_TOPICS = 3;  // that are named
const WINDOW = 100;  // messages of which the latency is told
const OLD_S = 3;
const QUIETEST_DB = -75, LOUDEST_DB = 0;  // of the microphone's level, relative to full scale

const $ = (id) => document.getElementById(id);
const milliseconds = (seconds) => `${Math.round(seconds * 1000)} ms`;
const percent = (part) => `${Math.round(part * 100)} %`;

function element(tag, text, className = '') {
  const made = document.createElement(tag);
  made.textContent = text;
  made.className = className;
  return made;
}

function meter(value, least, most) {
  const made = document.createElement('meter');
  Object.assign(made, {min: least, max: most, value});
  return made;
}

function row(texts, className = '') {
  const made = document.createElement('tr');
  made.className = className;
  made.append(...texts.map((text) => element('td', text)));
  return made;
}

export class Panels {
  constructor() {
    this.figures = new Map();
    this.heard = {};
    this.dirty = new Set();
    this.reset();
  }

  reset() {
    this.latencies = new Map();
    this.decisions = new Map();
    this.vehicle = this.arbiter = this.drive = this.command = this.localisation = null;
  }

  // Draws once per frame what changed.
  touch(part) {
    this.dirty.add(part);
    if (this.dirty.size === 1) {
      requestAnimationFrame(() => {
        const parts = [...this.dirty];
        this.dirty.clear();
        for (const one of parts) this[one]();
      });
    }
  }

  onVehicle(message) {
    this.vehicle = message;
    this.heard.vehicle = now();
    this.figures.set('odometer', [`${message.odometer.toFixed(1)} m`, '']);
    if (!Number.isNaN(message.battery_charge)) this.setBattery(message.battery_charge);
    this.touch('drawState');
    this.touch('drawHealth');
  }

  onState(name, message) {
    this[name] = message;
    this.heard[name] = now();
    this.touch('drawState');
  }

  setBattery(charge) {
    this.figures.set('battery', [percent(charge), charge < 0.05 ? 'bad' : charge < 0.2 ? 'warn' : '']);
  }

  onPower(message) {
    this.power = message;
    const {cpu, cores, total_watts: watts, measured, battery_charge: charge, remaining_time: left} = message;
    const share = cpu / Math.max(1, cores);
    this.figures.set('processor', [`${percent(share)} of ${cores} cores`, share > 0.95 ? 'warn' : '']);
    this.figures.set('power', [`${watts.toFixed(1)} W${measured ? '' : ' (model)'}`, '']);
    if (!Number.isNaN(charge)) this.setBattery(charge);
    if (Number.isFinite(left)) {
      const minutes = Math.round(left / 60);
      this.figures.set('battery lasts', [`${Math.floor(minutes / 60)} h ${minutes % 60} min`, '']);
    }
    this.touch('drawHealth');
    this.touch('drawPower');
  }

  onDiagnostics(message) {
    // Leaves of the tree alone: groups only repeat them.
    const leaves = message.status.filter((one) => one.name.split('/').length > 3 || !one.name.startsWith('/'));
    this.diagnostics = leaves.map((one) => (
      {level: Math.min(3, one.level), name: one.name.split('/').pop(), text: one.message}));
    const speech = new Map(leaves.filter(({name}) => name.includes('/Speech/'))
      .flatMap(({values}) => values.map(({key, value}) => [key, value])));
    const level = Number.parseFloat(speech.get('level [dB of full scale]'));
    if (Number.isFinite(level)) this.figures.set('microphone', [`${Math.round(level)} dB`, '', level]);
    if (speech.get('last command')) this.figures.set('heard', [speech.get('last command'), '']);
    this.touch('drawHealth');
  }

  onLatency(name, seconds) {
    const list = this.latencies.get(name) || [];
    list.push(seconds * 1000);
    if (list.length > WINDOW) list.shift();
    this.latencies.set(name, list);
    this.touch('drawLatency');
  }

  onRuntime(message) {
    this.streams = message.streams;
    this.touch('drawWork');
  }

  // pi_offload/OffloadDecision
  onDecision(message) {
    const list = this.decisions.get(message.kind) || [];
    list.push(message);
    if (list.length > WINDOW) list.shift();
    this.decisions.set(message.kind, list);
    this.decision = message;
    this.touch('drawWork');
  }

  onIncident(message) {
    this.newest = message;
    this.loadIncidents();
  }

  async loadIncidents() {
    try {
      const answer = await fetch(`incidents.json${location.search}`);
      if (!answer.ok) return;
      this.incidents = await answer.json();
      this.touch('drawIncidents');
    } catch (error) {
      // The connection is gone; the page says so elsewhere.
    }
  }

  // What carries the topics, as their publishers tell.
  async loadLinks() {
    try {
      const answer = await fetch(`links.json${location.search}`);
      if (!answer.ok) return;
      this.links = await answer.json();
      this.touch('drawWork');
    } catch (error) {
      // As above.
    }
  }

  // [what it does, its colour, why]
  words() {
    const {vehicle, arbiter, drive, command, localisation} = this;
    const fresh = (name) => Math.abs(now() - (this.heard[name] || 0)) < OLD_S * 1000;
    if (!vehicle && !arbiter) return ['no vehicle', 'warn', 'nobody tells what the vehicle does'];
    if (vehicle && !fresh('vehicle')) return ['vehicle silent', 'bad', 'the chassis driver says nothing any more'];
    const reasons = [];
    if (vehicle && vehicle.mode > 1) reasons.push(vehicle.detail || MODES[vehicle.mode]);
    if (command && command.stopped && command.reason) reasons.push(command.reason);
    if (drive && fresh('drive') && drive.feedback.reason) reasons.push(drive.feedback.reason);
    if (arbiter && arbiter.reason) reasons.push(arbiter.reason);
    if (localisation && !localisation.valid) reasons.push(`localisation: ${localisation.reason}`);
    const why = [...new Set(reasons)].join('; ');
    if ((arbiter && arbiter.emergency) || (vehicle && vehicle.mode === 3)) return ['emergency stop', 'bad', why];
    if (vehicle && vehicle.mode >= 4) return [MODES[vehicle.mode], 'bad', why];
    const moving = vehicle ? vehicle.moving : arbiter.driver !== '';
    if (moving) return ['drives', 'well', why];
    return ['stands', command && command.stopped ? 'bad' : 'warn', why];
  }

  drawState() {
    const [doing, colour, why] = this.words();
    $('doing').textContent = doing;
    $('doing').className = colour;
    $('why').textContent = why;
    $('speed').textContent = this.vehicle ? `${this.vehicle.speed.toFixed(1)} m/s` : '';
  }

  drawHealth() {
    const list = $('figures');
    list.replaceChildren();
    for (const name of ['battery', 'battery lasts', 'processor', 'power', 'odometer', 'microphone', 'heard']) {
      const figure = this.figures.get(name);
      if (!figure) continue;
      const [text, colour, level] = figure;
      const value = element('dd', text, colour);
      if (level !== undefined) value.prepend(meter(level, QUIETEST_DB, LOUDEST_DB));
      list.append(element('dt', name), value);
    }
    const bad = (this.diagnostics || []).filter(({level}) => level > 0).sort((a, b) => b.level - a.level);
    if (this.diagnostics) {
      const all = this.diagnostics.length;
      list.append(element('dt', 'diagnostics'),
        element('dd', bad.length ? `${bad.length} of ${all} complain` : `${all} well`, bad.length ? LEVELS[bad[0].level] : ''));
    }
    $('complaints').replaceChildren(...bad.slice(0, MOST_COMPLAINTS).map(({level, name, text}) => {
      const item = element('li', '', LEVELS[level]);
      item.append(element('b', name), ` ${level === 3 ? 'says nothing' : text}`);
      return item;
    }));
    if (bad.length > MOST_COMPLAINTS) $('complaints').append(element('li', `and ${bad.length - MOST_COMPLAINTS} more`));
  }

  drawPower() {
    $('no-power').hidden = true;
    const services = this.power.services.filter((one) => one.running).sort((a, b) => b.cpu - a.cpu);
    $('power').replaceChildren(...services.map((one) => {
      return row([one.name, `${(one.cpu * 100).toFixed(1)} %`, one.memory > 0 ? `${Math.round(one.memory / 1e6)} MB` : '',
        `${one.watts.toFixed(2)} W`]);
    }));
  }

  // Stages of the services on the computing units, and who does what can be sent away.
  drawWork() {
    $('work').hidden = false;
    const fill = (table, rows) => {
      $(table).hidden = rows.length === 0;
      $(table).tBodies[0].replaceChildren(...rows);
    };
    fill('streams', (this.streams || []).filter((one) => one.jobs > 0n).map((one) => {
      const late = Number(one.missed) / Number(one.jobs);
      return row([one.name.replaceAll('_', ' '), one.unit || 'any', milliseconds(one.p99_s), percent(late)],
        late > 0.01 ? 'warn' : '');
    }));
    fill('offloaded', [...this.decisions].sort().map(([kind, list]) => {
      const count = (how) => list.filter((one) => one.how === how).length;
      const times = list.map((one) => one.response_time).sort((a, b) => a - b);
      const late = list.filter((one) => !one.by_deadline).length / list.length;
      return row([kind, `${percent(count('remote') / list.length)} edge nodes`,
        milliseconds(times[times.length >> 1]), percent(late)], late > 0.05 ? 'warn' : '');
    }));
    fill('links', (this.links || []).map(({transport, links, topics}) => {
      const names = topics.slice(0, MOST_TOPICS).join(', ');
      return row([transport, links, topics.length > MOST_TOPICS ? `${topics.length}` : names]);
    }));
    if (this.decision) {
      const {kind, how, node, reason} = this.decision;
      $('last-decision').textContent = `${kind}: ${how}${how === 'remote' ? ` by ${node}` : ''}; ${reason}`;
    }
  }

  drawLatency() {
    $('latencies').replaceChildren(...[...this.latencies].sort().map(([name, list]) => {
      const sorted = [...list].sort((a, b) => a - b);
      return row([name, `${Math.round(sorted[sorted.length >> 1])} ms`, `${Math.round(sorted[sorted.length - 1])} ms`]);
    }));
  }

  drawIncidents() {
    const list = this.incidents || [];
    $('no-incident').hidden = list.length > 0;
    $('incident-list').replaceChildren(...list.map(({time, cause, megabytes, file}) => {
      const when = new Date(time.replace(/T(\d+)-(\d+)-(\d+)Z/, 'T$1:$2:$3Z'));
      const item = element('li', '');
      item.title = file;
      const link = element('a', cause.replaceAll('_', ' ') || 'incident');
      const query = new URLSearchParams(location.search);
      query.set('play', `incidents/${file}`);
      link.href = `?${query}`;
      item.append(link,
        ` ${Number.isNaN(when.getTime()) ? time : when.toLocaleString()}, ${megabytes.toFixed(1)} MB`);
      return item;
    }));
  }
}
