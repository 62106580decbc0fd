// The map: a canvas that is drawn when something changed.
import {now} from './clock.js';
import {compose, inverse, yawOf} from './frames.js';

const ZOOM = {least: 2, most: 200, first: 14};  // pixels per metre
const CLICK_PX = 6;      // a longer way of the pointer moves the map
const STALE_MS = 1500;   // obstacles older than that are gone
const MAX_CELLS = 16e6;

export class MapView {
  // onGoal(x, y, heading or undefined) in the frame of the map
  constructor(canvas, frames, onGoal) {
    this.canvas = canvas;
    this.frames = frames;
    this.onGoal = onGoal;
    this.frame = 'map';
    this.scale = ZOOM.first;
    this.centre = {x: 0, y: 0};
    this.follow = true;
    this.armed = false;
    this.grids = new Map();
    this.lines = new Map();
    this.edgeNodes = new Map();
    this.obstacles = null;
    this.odometry = null;
    this.goal = null;
    this.footprint = {front: 1, rear: 0.3, half_width: 0.4};
    this.pointers = new Map();
    new ResizeObserver(() => this.changed()).observe(canvas);
    canvas.addEventListener('pointerdown', (event) => this.onDown(event));
    canvas.addEventListener('pointermove', (event) => this.onMove(event));
    for (const name of ['pointerup', 'pointercancel']) canvas.addEventListener(name, (event) => this.onUp(event));
    canvas.addEventListener('wheel', (event) => this.onWheel(event), {passive: false});
    canvas.addEventListener('keydown', (event) => this.onKey(event));
  }

  // What was shown is of another time.
  reset() {
    this.obstacles = this.odometry = this.goal = null;
    this.lines.clear();
    this.changed();
  }

  changed() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.draw();
    });
  }

  onGrid(name, message) {
    const {width, height} = message.info;
    if (!width || !height || width * height > MAX_CELLS) return;
    const picture = new ImageData(width, height);
    const pixels = new Uint32Array(picture.data.buffer);
    for (let y = 0; y < height; ++y) {
      for (let x = 0; x < width; ++x) {
        const cell = message.data[y * width + x];
        if (cell >= 0) pixels[(height - 1 - y) * width + x] = cell >= 50 ? 0xd0605850 : 0x30a0c890;
      }
    }
    const canvas = document.createElement('canvas');
    canvas.width = width;
    canvas.height = height;
    canvas.getContext('2d').putImageData(picture, 0, 0);
    const {position, orientation} = message.info.origin;
    this.grids.set(name, {canvas, frame: message.header.frame_id, resolution: message.info.resolution,
      origin: {x: position.x, y: position.y, yaw: yawOf(orientation)}});
    this.changed();
  }

  onPath(name, message) {
    this.lines.set(name, {frame: message.header.frame_id, points: message.poses.map(({pose}) => pose.position)});
    this.changed();
  }

  // The offloading's markers for rviz: places, ranges and names of edge nodes, and which of them works.
  onEdgeNodes(message) {
    for (const marker of message.markers) {
      const key = `${marker.ns} ${marker.id}`;
      if (marker.action === 2 || marker.action === 3) this.edgeNodes.delete(key);
      else this.edgeNodes.set(key, marker);
    }
    this.changed();
  }

  onObstacles(message) {
    this.obstacles = {...message, came: now()};
    this.changed();
  }

  onOdometry(message) {
    const {position, orientation} = message.pose.pose;
    this.odometry = {parent: message.header.frame_id, child: message.child_frame_id || 'base_link',
      pose: {x: position.x, y: position.y, yaw: yawOf(orientation)}};
    this.changed();
  }

  // In the frame of the map; null while unknown. Where tf does not tell it, odometry does.
  pose() {
    const placed = this.frames.lookup(this.frame, this.vehicleFrame());
    if (placed || !this.odometry) return placed;
    const parent = this.frames.lookup(this.frame, this.odometry.parent);
    return parent ? compose(parent, this.odometry.pose) : this.odometry.pose;
  }

  // Points of the route before the vehicle, in its frame, as far as they lie ahead [m].
  wayAhead(metres) {
    const line = this.lines.get('route');
    const base = line && this.poseOf(line.frame);
    const pose = this.pose();
    if (!base || !pose) return [];
    const toVehicle = compose(inverse(pose), base);
    const points = line.points.map((point) => compose(toVehicle, {x: point.x, y: point.y, yaw: 0}));
    const nearest = points.reduce((best, point, i) => (
      Math.hypot(point.x, point.y) < Math.hypot(points[best].x, points[best].y) ? i : best), 0);
    const way = [];
    for (let i = nearest; i < points.length && Math.hypot(points[i].x, points[i].y) < metres; ++i) way.push(points[i]);
    return way;
  }

  // Whether tf tells where the vehicle is in the map's frame.
  isPlaced() { return this.frames.lookup(this.frame, this.odometry ? this.odometry.parent : 'base_link') !== null; }

  vehicleFrame() { return this.odometry ? this.odometry.child : 'base_link'; }

  poseOf(frame) {
    if (this.odometry && frame === this.odometry.child) return this.pose();
    return this.frames.lookup(this.frame, frame);
  }

  // ------------------------------------------------------------------------------------------------------- coordinates

  toScreen(point) {
    const {clientWidth: w, clientHeight: h} = this.canvas;
    return [w / 2 + (point.x - this.centre.x) * this.scale, h / 2 - (point.y - this.centre.y) * this.scale];
  }

  toMap(x, y) {
    const {clientWidth: w, clientHeight: h} = this.canvas;
    return {x: this.centre.x + (x - w / 2) / this.scale, y: this.centre.y - (y - h / 2) / this.scale};
  }

  setFollow(on) {
    this.follow = on;
    this.canvas.dispatchEvent(new CustomEvent('follow', {detail: on}));
    this.changed();
  }

  zoom(factor, x, y) {
    const before = this.toMap(x, y);
    this.scale = Math.min(ZOOM.most, Math.max(ZOOM.least, this.scale * factor));
    const after = this.toMap(x, y);
    if (!this.follow) this.centre = {x: this.centre.x + before.x - after.x, y: this.centre.y + before.y - after.y};
    this.changed();
  }

  // ------------------------------------------------------------------------------------------------------------- input

  onDown(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, {x: event.offsetX, y: event.offsetY});
    this.down = this.pointers.size === 1 ? {x: event.offsetX, y: event.offsetY, moved: false} : null;
  }

  onMove(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const now = {x: event.offsetX, y: event.offsetY};
    this.pointers.set(event.pointerId, now);
    if (this.pointers.size === 2) {
      const [a, b] = [...this.pointers.values()];
      const other = now === a ? b : a;
      const length = (p) => Math.hypot(p.x - other.x, p.y - other.y);
      this.zoom(length(now) / Math.max(1, length(before)), (a.x + b.x) / 2, (a.y + b.y) / 2);
    } else if (this.down) {
      if (Math.hypot(now.x - this.down.x, now.y - this.down.y) > CLICK_PX) this.down.moved = true;
      if (this.armed) {
        this.aim = this.down.moved ? {from: this.toMap(this.down.x, this.down.y), to: this.toMap(now.x, now.y)} : null;
        this.changed();
      } else if (this.down.moved) {
        if (this.follow) this.setFollow(false);
        this.centre = {x: this.centre.x - (now.x - before.x) / this.scale,
          y: this.centre.y + (now.y - before.y) / this.scale};
        this.changed();
      }
    }
  }

  onUp(event) {
    this.pointers.delete(event.pointerId);
    if (this.down && this.armed && event.type === 'pointerup') {
      const from = this.toMap(this.down.x, this.down.y);
      const to = this.toMap(event.offsetX, event.offsetY);
      this.onGoal(from.x, from.y, this.down.moved ? Math.atan2(to.y - from.y, to.x - from.x) : undefined);
    }
    this.down = null;
    this.aim = null;
  }

  onWheel(event) {
    event.preventDefault();
    this.zoom(Math.exp(-event.deltaY * 0.0015), event.offsetX, event.offsetY);
  }

  onKey(event) {
    const step = 40 / this.scale;
    const moves = {ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, step], ArrowDown: [0, -step]};
    const {clientWidth: w, clientHeight: h} = this.canvas;
    if (moves[event.key]) {
      this.setFollow(false);
      this.centre = {x: this.centre.x + moves[event.key][0], y: this.centre.y + moves[event.key][1]};
    } else if (event.key === '+' || event.key === '-') {
      this.zoom(event.key === '+' ? 1.25 : 0.8, w / 2, h / 2);
    } else {
      return;
    }
    event.preventDefault();
    this.changed();
  }

  // ----------------------------------------------------------------------------------------------------------- drawing

  draw() {
    const {canvas} = this;
    const ratio = Math.min(2, window.devicePixelRatio || 1);
    const [w, h] = [canvas.clientWidth, canvas.clientHeight];
    if (canvas.width !== Math.round(w * ratio) || canvas.height !== Math.round(h * ratio)) {
      canvas.width = Math.round(w * ratio);
      canvas.height = Math.round(h * ratio);
    }
    const style = getComputedStyle(canvas);
    this.colour = (name) => style.getPropertyValue(`--${name}`).trim();
    const context = canvas.getContext('2d');
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, w, h);
    const pose = this.pose();
    if (this.follow && pose) this.centre = {x: pose.x, y: pose.y};
    this.drawRaster(context, w, h);
    for (const grid of this.grids.values()) this.drawGrid(context, grid);
    this.drawLine(context, 'path', this.colour('path'), 2);
    this.drawLine(context, 'route', this.colour('route'), 4);
    this.drawEdgeNodes(context);
    if (this.goal) this.drawGoal(context, this.goal);
    if (this.aim) this.drawAim(context);
    if (pose) this.drawVehicle(context, pose);
    if (this.obstacles && now() - this.obstacles.came < STALE_MS) this.drawObstacles(context);
    this.drawScale(context, h);
  }

  // A line each metre, 5, 10 or 50 metres, so that they are 40 pixels apart at least.
  step() { return [1, 5, 10, 50].find((metres) => metres * this.scale >= 40) || 100; }

  drawRaster(context, w, h) {
    const step = this.step();
    const a = this.toMap(0, h);
    const b = this.toMap(w, 0);
    context.strokeStyle = this.colour('raster');
    context.lineWidth = 1;
    context.beginPath();
    for (let x = Math.ceil(a.x / step) * step; x <= b.x; x += step) {
      const [sx] = this.toScreen({x, y: 0});
      context.moveTo(Math.round(sx) + 0.5, 0);
      context.lineTo(Math.round(sx) + 0.5, h);
    }
    for (let y = Math.ceil(a.y / step) * step; y <= b.y; y += step) {
      const [, sy] = this.toScreen({x: 0, y});
      context.moveTo(0, Math.round(sy) + 0.5);
      context.lineTo(w, Math.round(sy) + 0.5);
    }
    context.stroke();
  }

  drawScale(context, h) {
    const step = this.step();
    context.fillStyle = this.colour('soft');
    context.fillRect(12, h - 14, step * this.scale, 2);
    context.font = '12px system-ui, sans-serif';
    context.strokeStyle = this.colour('panel');
    context.lineWidth = 3;
    context.strokeText(`${step} m`, 12, h - 20);
    context.fillText(`${step} m`, 12, h - 20);
  }

  drawGrid(context, {canvas, frame, resolution, origin}) {
    const base = this.poseOf(frame);
    if (!base) return;
    const corner = compose(base, origin);
    context.save();
    context.translate(...this.toScreen(corner));
    context.rotate(-corner.yaw);
    context.imageSmoothingEnabled = false;
    const size = resolution * this.scale;
    context.drawImage(canvas, 0, -canvas.height * size, canvas.width * size, canvas.height * size);
    context.restore();
  }

  drawLine(context, name, colour, width) {
    const line = this.lines.get(name);
    const base = line && this.poseOf(line.frame);
    if (!base || line.points.length < 2) return;
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.lineJoin = 'round';
    context.beginPath();
    let last = [-1e9, -1e9];
    line.points.forEach((point, i) => {
      const [x, y] = this.toScreen(compose(base, {x: point.x, y: point.y, yaw: 0}));
      if (i > 0 && i < line.points.length - 1 && Math.abs(x - last[0]) + Math.abs(y - last[1]) < 2) return;
      last = [x, y];
      context.lineTo(x, y);
    });
    context.stroke();
  }

  polygon(context, points) {
    context.beginPath();
    for (const point of points) context.lineTo(...this.toScreen(point));
    context.closePath();
  }

  drawVehicle(context, pose) {
    const {front, rear, half_width: side} = this.footprint;
    const corner = (x, y) => compose(pose, {x, y, yaw: 0});
    context.fillStyle = this.colour('vehicle');
    this.polygon(context, [corner(front, 0), corner(front - 0.3 * (front + rear), side), corner(-rear, side),
      corner(-rear, -side), corner(front - 0.3 * (front + rear), -side)]);
    context.fill();
    context.strokeStyle = this.colour('panel');
    context.lineWidth = 1.5;
    context.stroke();
  }

  drawObstacles(context) {
    const base = this.poseOf(this.obstacles.header.frame_id);
    if (!base) return;
    context.font = '12px system-ui, sans-serif';
    context.textAlign = 'center';
    const taken = [];
    for (const one of this.obstacles.obstacles) {
      const at = (x, y) => compose(base, {x, y, yaw: 0});
      const {x, y} = one.position;
      const [sx, sy] = [one.size.x / 2, one.size.y / 2];
      const outline = one.outline.length > 2 ? one.outline.map((point) => at(point.x, point.y))
        : [at(x - sx, y - sy), at(x + sx, y - sy), at(x + sx, y + sy), at(x - sx, y + sy)];
      const colour = this.colour(one.label === 'person' ? 'person' : one.label ? 'thing' : 'unknown');
      context.fillStyle = colour;
      context.globalAlpha = 0.55;
      this.polygon(context, outline);
      context.fill();
      context.globalAlpha = 1;
      const speed = Math.hypot(one.velocity.x, one.velocity.y);
      const centre = at(x, y);
      const [cx, cy] = this.toScreen(centre);
      if (one.moving) {
        context.strokeStyle = colour;
        context.lineWidth = 2;
        context.beginPath();
        context.moveTo(cx, cy);
        context.lineTo(...this.toScreen(at(x + one.velocity.x, y + one.velocity.y)));
        context.stroke();
      }
      const text = [one.label, one.moving ? `${speed.toFixed(1)} m/s` : ''].filter(Boolean).join(' ');
      const top = Math.min(...outline.map((point) => this.toScreen(point)[1])) - 5;
      const width = text ? context.measureText(text).width : 0;
      if (text && !taken.some((box) => Math.abs(box.x - cx) < (box.w + width) / 2 && Math.abs(box.y - top) < 13)) {
        taken.push({x: cx, y: top, w: width});
        context.lineWidth = 3;
        context.strokeStyle = this.colour('panel');
        context.strokeText(text, cx, top);
        context.fillStyle = this.colour('text');
        context.fillText(text, cx, top);
      }
    }
    context.textAlign = 'start';
  }

  drawEdgeNodes(context) {
    context.font = '12px system-ui, sans-serif';
    for (const {ns, header, pose, points, color, text} of this.edgeNodes.values()) {
      const base = this.poseOf(header.frame_id);
      if (!base) continue;
      const at = (point) => this.toScreen(compose(base, {x: point.x, y: point.y, yaw: 0}));
      const [x, y] = at(pose.position);
      context.strokeStyle = context.fillStyle =
        `rgb(${[color.r, color.g, color.b].map((part) => Math.round(255 * part)).join()})`;
      if (ns === 'nodes') {
        context.fillRect(x - 5, y - 5, 10, 10);
      } else if (ns === 'names') {
        context.fillStyle = this.colour('text');
        context.fillText(text, x + 9, y + 4);
      } else {
        context.globalAlpha = color.a;
        context.lineWidth = ns === 'links' ? 2 : 1;
        context.beginPath();
        for (const point of points) context.lineTo(...at(point));
        context.stroke();
        context.globalAlpha = 1;
      }
    }
  }

  drawGoal(context, goal) {
    const [x, y] = this.toScreen(goal);
    context.fillStyle = this.colour('goal');
    context.strokeStyle = this.colour('panel');
    context.lineWidth = 2;
    context.beginPath();
    context.arc(x, y, 7, 0, 2 * Math.PI);
    context.fill();
    context.stroke();
  }

  drawAim(context) {
    context.strokeStyle = this.colour('goal');
    context.lineWidth = 3;
    context.beginPath();
    context.moveTo(...this.toScreen(this.aim.from));
    context.lineTo(...this.toScreen(this.aim.to));
    context.stroke();
  }
}
