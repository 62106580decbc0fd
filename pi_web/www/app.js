// Ties the connection to map, camera and panels.
import {CameraView} from './camera.js';
import {Connection} from './connection.js';
import {Frames} from './frames.js';
import {MapView} from './map.js';
import {Panels} from './panels.js';
import {Playback} from './playback.js';
import {poseStamped} from './rosmsg.js';

const GOAL = '/goal';
const POSE_TYPE = 'geometry_msgs/PoseStamped';
const SERVICES = {stop: '/command/stop', go: '/command/release', cancel: '/navigation/cancel'};
const INCIDENTS_AGAIN_MS = 15000;
const LINKS_AGAIN_MS = 15000;
const LINKS_FIRST_MS = 4000;  // after the first question, which only wakes the server
const HINT_MS = 6000;

const $ = (id) => document.getElementById(id);
const frames = new Frames();
const panels = new Panels();
const map = new MapView($('map-canvas'), frames, onGoal);
const camera = new CameraView($('camera-canvas'), $('no-picture'), map, frames);
const query = new URLSearchParams(location.search);
const recording = query.get('play');
const vehicle = !recording || recording.startsWith('incidents/');  // serves this page
const address = new URL('.', location.href);
address.protocol = address.protocol === 'https:' ? 'wss:' : 'ws:';
address.search = location.search;

let controls = false;
const handlers = {
  onState(connected, text) {
    $('connection').textContent = connected ? (recording ? 'recording' : 'connected') : 'not connected';
    $('connection').className = `badge ${!connected ? 'bad' : recording ? '' : 'well'}`;
    $('lost').hidden = connected;
    $('lost').textContent = connected ? ''
      : recording ? text : `Connection lost: ${text}. What you see is old. Trying again.`;
    $('player').hidden = !recording;
    if (connected && vehicle) panels.loadIncidents();
    if (connected && !recording) {
      panels.loadLinks();
      setTimeout(() => panels.loadLinks(), LINKS_FIRST_MS);
    }
  },
  onControl(allowed) {
    controls = allowed;
    for (const [button, service] of Object.entries(SERVICES)) {
      $(button).disabled = !(allowed && connection.hasService(service));
    }
    showGoal();
    if (!allowed) arm(false);
  },
  onStatus: hint,
  onTopics() {
    chooseCamera();
    watchWork();
  },
  onReset() {
    for (const view of [map, camera, panels]) view.reset();
  },
  onTime: showTime,
};
const connection = recording ? new Playback(`${recording}${location.search}`, handlers)
  : new Connection(address.href, handlers);

// A goal is in the map: not before it is known where that is.
function showGoal() { $('goal').disabled = !(controls && map.isPlaced()); }

let hintTimer = 0;
function hint(text) {
  $('hint').textContent = text;
  clearTimeout(hintTimer);
  hintTimer = setTimeout(() => { $('hint').textContent = ''; }, HINT_MS);
}

// ----------------------------------------------------------------------------------------------------------- controls

function arm(on) {
  map.armed = on;
  $('goal').setAttribute('aria-pressed', on);
  $('map-canvas').classList.toggle('armed', on);
  if (on) hint('Click where to; drag for the heading. Escape ends.');
}

function onGoal(x, y, heading) {
  connection.publish(GOAL, poseStamped(map.frame, x, y, heading));
  map.goal = {x, y};
  map.changed();
  arm(false);
  hint(`goal: ${x.toFixed(1)}, ${y.toFixed(1)}`);
}

for (const [button, service] of Object.entries(SERVICES)) {
  $(button).addEventListener('click', async () => {
    try {
      const {success, message} = await connection.call(service);
      hint(message || (success ? 'done' : 'refused'));
      if (button === 'cancel' && success) map.goal = null;
      map.changed();
    } catch (error) {
      hint(`${button}: ${error.message}`);
    }
  });
}
$('goal').addEventListener('click', () => arm(!map.armed));
$('follow').addEventListener('click', () => map.setFollow(!map.follow));
$('map-canvas').addEventListener('follow', (event) => $('follow').setAttribute('aria-pressed', event.detail));
const middle = () => [$('map-canvas').clientWidth / 2, $('map-canvas').clientHeight / 2];
$('in').addEventListener('click', () => map.zoom(1.4, ...middle()));
$('out').addEventListener('click', () => map.zoom(1 / 1.4, ...middle()));
document.addEventListener('keydown', (event) => {
  if (event.key === 'Escape') arm(false);
});
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => map.changed());

// ---------------------------------------------------------------------------------------------------------- recording

function showTime(time, begin, end, playing) {
  $('moment').max = end - begin;
  $('moment').value = time - begin;
  $('when').textContent = `${(time - begin).toFixed(1)} of ${(end - begin).toFixed(1)} s`;
  $('play').textContent = playing ? 'Pause' : 'Play';
  $('play').setAttribute('aria-pressed', playing);
}

if (recording) {
  query.delete('play');
  $('live').hidden = $('incidents').hidden = !vehicle;
  $('live').href = `./?${query}`;
  $('play').addEventListener('click', () => connection.play(!connection.playing));
  $('moment').addEventListener('input', () => {
    connection.seek(connection.begin + Number($('moment').value));
    if (connection.playing) connection.play(true);
  });
}

// ------------------------------------------------------------------------------------------------------------- camera

let watched = '';
function watchCamera(topic) {
  if (topic === watched) return;
  if (watched) connection.unsubscribe(watched);
  watched = topic;
  camera.reset();
  camera.info = null;
  camera.rectified = /rect/.test(topic);
  if (!topic) return;
  connection.subscribe(topic, timed('picture', (message) => camera.onPicture(message)));
  const about = topic.replace(/\/image[^/]*(\/(web|compressed))?$/, '/camera_info');
  connection.subscribe(about, (message) => {
    camera.info = message;
    connection.unsubscribe(about);  // it does not change
  });
}

function chooseCamera() {
  const topics = connection.topicsOf('sensor_msgs/CompressedImage');
  const select = $('topic');
  select.hidden = topics.length < 2;
  if (topics.join() !== [...select.options].map((one) => one.value).join()) {
    select.replaceChildren(...topics.map((topic) => new Option(topic.replace(/\/web$/, ''), topic)));
    const first = [watched, topics.find((topic) => topic.includes('left/image')), topics[0]]
      .find((topic) => topics.includes(topic)) || '';
    select.value = first;
    watchCamera(first);
  }
}
$('topic').addEventListener('change', () => watchCamera($('topic').value));

// Topics that are found by their type, as their nodes have different names.
function watchWork() {
  for (const topic of connection.topicsOf('pi_runtime/RuntimeStatus')) {
    connection.subscribe(topic, (message) => panels.onRuntime(message));
  }
  for (const topic of connection.topicsOf('pi_offload/OffloadDecision')) {
    connection.subscribe(topic, (message) => panels.onDecision(message));
  }
}

// ------------------------------------------------------------------------------------------------------------- topics

// Notes how old a message was when it came to the vehicle's server, by the vehicle's clock.
function noteAge(name, {header}, stamp) {
  const age = stamp - header.stamp;
  if (header.stamp > 0 && age > -1 && age < 60) panels.onLatency(name, Math.max(0, age));
}

function timed(name, callback) {
  return (message, topic, stamp) => {
    noteAge(name, message, stamp);
    callback(message);
  };
}

connection.publishes(GOAL, POSE_TYPE);
for (const topic of ['/tf/web', '/tf_static']) {
  connection.subscribe(topic, (message, name, stamp) => {
    frames.onTransforms(message);
    const ofVehicle = message.transforms.find((one) => one.child_frame_id === map.vehicleFrame());
    if (ofVehicle) noteAge('pose', ofVehicle, stamp);
    map.changed();
    showGoal();
  });
}
connection.subscribe('/odometry/web', timed('pose', (message) => {
  map.onOdometry(message);
  // It comes 200 times per second, and then tells nothing new.
  if (frames.lookup(map.frame, map.vehicleFrame())) connection.unsubscribe('/odometry/web');
}));
connection.subscribe('/obstacles/web', timed('obstacles', (message) => map.onObstacles(message)));
connection.subscribe('/tracks/web', timed('tracks', (message) => camera.onTracks(message)));
connection.subscribe('/route', (message) => map.onPath('route', message));
connection.subscribe('/path', (message) => map.onPath('path', message));
connection.subscribe('/coordinator/markers', (message) => map.onEdgeNodes(message));
connection.subscribe('/map', (message) => map.onGrid('map', message));
connection.subscribe('/grid', (message) => map.onGrid('grid', message));
connection.subscribe('/vehicle_state/web', (message) => panels.onVehicle(message));
connection.subscribe('/arbiter/state', (message) => panels.onState('arbiter', message));
connection.subscribe('/command/state', (message) => panels.onState('command', message));
connection.subscribe('/localisation', (message) => panels.onState('localisation', message));
connection.subscribe('/drive/feedback', (message) => panels.onState('drive', message));
connection.subscribe('/power', (message) => panels.onPower(message));
connection.subscribe('/diagnostics_agg', (message) => panels.onDiagnostics(message));
connection.subscribe('/incident', (message) => panels.onIncident(message));
connection.parameters(['/vehicle/footprint'], ([{value}]) => {
  if (value && value.front > 0) map.footprint = value;
  map.changed();
});
setInterval(() => panels.touch('drawState'), 1000);  // a vehicle that falls silent
if (vehicle) setInterval(() => panels.loadIncidents(), INCIDENTS_AGAIN_MS);
if (!recording) setInterval(() => panels.loadLinks(), LINKS_AGAIN_MS);
