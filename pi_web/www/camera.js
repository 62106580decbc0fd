// The camera's picture with the boxes of the tracks and the way that the vehicle will take.
import {now} from './clock.js';

const STALE_MS = 1000;
const NEAR_M = 0.3;     // before the lens: what is nearer is not drawn
const AHEAD_M = 12;
const PIECE_M = 0.25;   // of the way: straight in the picture
const FIELD = 1.5;      // tangent of the angle up to which the lens's model holds

// Where a point before the camera is in the picture, by sensor_msgs/CameraInfo: plumb_bob and rational_polynomial,
// none for pictures that are rectified; null for other models, and beside the picture.
function pixelOf(info, rectified, {x, y, z}) {
  if (z < NEAR_M || Math.hypot(x, y) > FIELD * z) return null;
  let [u, v] = [x / z, y / z];
  const [k1, k2, p1, p2, k3, k4, k5, k6] = [...info.D, ...new Array(8).fill(0)];
  if (!rectified) {
    if (!['plumb_bob', 'rational_polynomial', ''].includes(info.distortion_model)) return null;
    const r = u * u + v * v;
    const radial = (1 + r * (k1 + r * (k2 + r * k3))) / (1 + r * (k4 + r * (k5 + r * k6)));
    [u, v] = [u * radial + 2 * p1 * u * v + p2 * (r + 2 * u * u), v * radial + p1 * (r + 2 * v * v) + 2 * p2 * u * v];
  }
  const [fx, cx, fy, cy] = rectified ? [info.P[0], info.P[2], info.P[5], info.P[6]]
    : [info.K[0], info.K[2], info.K[4], info.K[5]];
  return fx > 0 ? [fx * u + cx, fy * v + cy] : null;
}

// Points between those of a line, each PIECE_M.
function divided(line) {
  return line.flatMap((point, i) => {
    const next = line[i + 1] || point;
    const pieces = Math.max(1, Math.ceil(Math.hypot(next.x - point.x, next.y - point.y) / PIECE_M));
    return Array.from({length: pieces}, (_, k) => ({x: point.x + (next.x - point.x) * k / pieces,
      y: point.y + (next.y - point.y) * k / pieces, yaw: Math.atan2(next.y - point.y, next.x - point.x)}));
  });
}

export class CameraView {
  // map: tells the way and the width of the vehicle. frames: where the camera is
  constructor(canvas, placeholder, map, frames) {
    this.canvas = canvas;
    this.placeholder = placeholder;
    this.map = map;
    this.frames = frames;
    this.tracks = null;
    this.info = null;
    this.busy = false;
  }

  // Of another camera, or of another time.
  reset() { this.tracks = null; }

  // sensor_msgs/CompressedImage. While the browser still decodes one, the next waits, and the newest stays.
  async onPicture(message) {
    this.next = message;
    if (this.busy) return;
    this.busy = true;
    while (this.next) {
      const picture = this.next;
      this.next = null;
      try {
        const bitmap = await createImageBitmap(new Blob([picture.data], {type: 'image/jpeg'}));
        const full = /(\d+)x(\d+)/.exec(picture.format);
        this.width = full ? Number(full[1]) : bitmap.width;
        this.frame = picture.header.frame_id;
        if (this.bitmap) this.bitmap.close();
        this.bitmap = bitmap;
        this.draw();
      } catch (error) {
        console.warn('a picture is not shown:', error);
      }
    }
    this.busy = false;
  }

  onTracks(message) {
    this.tracks = {list: message.tracks, came: now()};
    this.draw();
  }

  draw() {
    const {canvas, bitmap} = this;
    if (!bitmap) return;
    this.placeholder.hidden = true;
    canvas.hidden = false;
    if (canvas.width !== bitmap.width || canvas.height !== bitmap.height) {
      canvas.width = bitmap.width;
      canvas.height = bitmap.height;
    }
    const context = canvas.getContext('2d');
    context.drawImage(bitmap, 0, 0);
    this.drawWay(context);
    if (!this.tracks || now() - this.tracks.came > STALE_MS) return;
    const scale = bitmap.width / this.width;
    const line = Math.max(2, bitmap.width / 320);
    context.lineWidth = line;
    context.font = `600 ${Math.max(11, Math.round(bitmap.width / 34))}px system-ui, sans-serif`;
    context.textBaseline = 'bottom';
    const style = getComputedStyle(canvas);
    for (const track of this.tracks.list) {
      const {center, size_x: w, size_y: h} = track.bbox;
      const [x, y] = [(center.x - w / 2) * scale, (center.y - h / 2) * scale];
      const colour = style.getPropertyValue(track.label === 'person' ? '--person' : '--thing').trim();
      context.strokeStyle = colour;
      context.strokeRect(x, y, w * scale, h * scale);
      const text = `${track.label ? `${track.label} ` : ''}${Math.round(track.score * 100)} %`;
      const height = parseInt(context.font.split(' ')[1], 10) + 6;
      const top = y < height ? y + height : y;
      context.fillStyle = colour;
      context.fillRect(x - line / 2, top - height, context.measureText(text).width + 8, height);
      context.fillStyle = '#fff';
      context.fillText(text, x + 4 - line / 2, top - 3);
    }
  }
  // The strip that the vehicle will drive over.
  drawWay(context) {
    const {info, map} = this;
    const take = info && this.frames.taking(this.frame, map.vehicleFrame());
    if (!take) return;
    const scale = this.bitmap.width / info.width;
    const {front, half_width: side} = map.footprint;
    const way = divided(map.wayAhead(AHEAD_M)).filter((point) => point.x > front);
    const edge = (left) => way.map(({x, y, yaw}) => (
      pixelOf(info, this.rectified, take({x: x - left * Math.sin(yaw), y: y + left * Math.cos(yaw), z: 0}))));
    const [left, right] = [edge(side), edge(-side)];
    const seen = way.map((_, i) => i).filter((i) => left[i] && right[i]);
    if (seen.length < 2) return;
    context.beginPath();
    for (const i of seen) context.lineTo(left[i][0] * scale, left[i][1] * scale);
    for (const i of seen.reverse()) context.lineTo(right[i][0] * scale, right[i][1] * scale);
    context.closePath();
    context.globalAlpha = 0.35;
    context.fillStyle = getComputedStyle(this.canvas).getPropertyValue('--route').trim();
    context.fill();
    context.globalAlpha = 1;
  }
}
