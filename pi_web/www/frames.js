// The tree of tf in the plane: enough for a vehicle on the ground.

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
        pose: {x: translation.x, y: translation.y, yaw: yawOf(rotation)}});
    }
  }

  // To the root of the tree.
  chain(frame) {
    let pose = {x: 0, y: 0, yaw: 0};
    let name = clean(frame);
    for (let depth = 0; depth < 50 && this.parents.has(name); ++depth) {
      const link = this.parents.get(name);
      pose = compose(link.pose, pose);
      name = link.parent;
    }
    return {root: name, pose};
  }

  // Pose of a frame in another; null if tf does not connect them.
  lookup(target, frame) {
    if (clean(target) === clean(frame)) return {x: 0, y: 0, yaw: 0};
    const from = this.chain(frame);
    const to = this.chain(target);
    return from.root === to.root ? compose(inverse(to.pose), from.pose) : null;
  }
}

function clean(frame) { return frame.replace(/^\/+/, ''); }
