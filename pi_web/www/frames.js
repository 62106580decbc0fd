// The tree of tf: in the plane, for a vehicle on the ground, and in space, for its cameras.

export function yawOf(q) {
  return Math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z));
}

// Pose b, given in a, in the frame of a.
export function compose(a, b) {
  const c = Math.cos(a.yaw);
  const s = Math.sin(a.yaw);
  return {x: a.x + c * b.x - s * b.y, y: a.y + s * b.x + c * b.y, yaw: a.yaw + b.yaw};
}

export function inverse(a) {
  const c = Math.cos(a.yaw);
  const s = Math.sin(a.yaw);
  return {x: -c * a.x - s * a.y, y: s * a.x - c * a.y, yaw: -a.yaw};
}

export class Frames {
  constructor() {
    this.parents = new Map();  // child -> {parent, pose}
  }

  onTransforms(message) {
    for (const {header, child_frame_id: child, transform: {translation, rotation}} of message.transforms) {
      this.parents.set(clean(child), {parent: clean(header.frame_id),
        pose: {x: translation.x, y: translation.y, yaw: yawOf(rotation)}, translation, rotation});
    }
  }

  // Links from a frame to the root of its tree.
  links(frame) {
    const links = [];
    let name = clean(frame);
    for (; links.length < 50 && this.parents.has(name); name = links[links.length - 1].parent) {
      links.push(this.parents.get(name));
    }
    return {root: name, links};
  }

  // Pose of a frame in the root of its tree.
  chain(frame) {
    const {root, links} = this.links(frame);
    return {root, pose: links.reduce((pose, link) => compose(link.pose, pose), {x: 0, y: 0, yaw: 0})};
  }

  // A function that takes a point in space {x, y, z} from one frame to another; null if tf does not connect them.
  taking(target, frame) {
    const from = this.links(frame);
    const to = this.links(target);
    if (from.root !== to.root) return null;
    return (point) => {
      let p = point;
      for (const {translation: t, rotation} of from.links) {
        const r = rotate(rotation, p);
        p = {x: r.x + t.x, y: r.y + t.y, z: r.z + t.z};
      }
      for (const {translation: t, rotation: q} of [...to.links].reverse()) {
        p = rotate({x: -q.x, y: -q.y, z: -q.z, w: q.w}, {x: p.x - t.x, y: p.y - t.y, z: p.z - t.z});
      }
      return p;
    };
  }

  // Pose of a frame in another; null if tf does not connect them.
  lookup(target, frame) {
    if (clean(target) === clean(frame)) return {x: 0, y: 0, yaw: 0};
    const from = this.chain(frame);
    const to = this.chain(target);
    return from.root === to.root ? compose(inverse(to.pose), from.pose) : null;
  }
}

function rotate(q, p) {
  const [a, b, c] = [2 * (q.y * p.z - q.z * p.y), 2 * (q.z * p.x - q.x * p.z), 2 * (q.x * p.y - q.y * p.x)];
  return {x: p.x + q.w * a + q.y * c - q.z * b, y: p.y + q.w * b + q.z * a - q.x * c,
    z: p.z + q.w * c + q.x * b - q.y * a};
}

function clean(frame) { return frame.replace(/^\/+/, ''); }
