// Messages of ROS 1 by their definitions, as the channels of the Foxglove protocol bring them.

const SIZES = {bool: 1, byte: 1, char: 1, int8: 1, uint8: 1, int16: 2, uint16: 2, int32: 4, uint32: 4, int64: 8,
  uint64: 8, float32: 4, float64: 8, time: 8, duration: 8};
const READ = {
  bool: (v, o) => v.getUint8(o) !== 0,
  byte: (v, o) => v.getInt8(o),
  char: (v, o) => v.getUint8(o),
  int8: (v, o) => v.getInt8(o),
  uint8: (v, o) => v.getUint8(o),
  int16: (v, o) => v.getInt16(o, true),
  uint16: (v, o) => v.getUint16(o, true),
  int32: (v, o) => v.getInt32(o, true),
  uint32: (v, o) => v.getUint32(o, true),
  int64: (v, o) => v.getBigInt64(o, true),
  uint64: (v, o) => v.getBigUint64(o, true),
  float32: (v, o) => v.getFloat32(o, true),
  float64: (v, o) => v.getFloat64(o, true),
  time: (v, o) => v.getUint32(o, true) + v.getUint32(o + 4, true) * 1e-9,
  duration: (v, o) => v.getInt32(o, true) + v.getInt32(o + 4, true) * 1e-9,
};
const ARRAYS = {int8: Int8Array, byte: Int8Array, uint8: Uint8Array, char: Uint8Array, int16: Int16Array,
  uint16: Uint16Array, int32: Int32Array, uint32: Uint32Array, float32: Float32Array, float64: Float64Array};

// {type name: [{name, type, array: undefined | 0 (any length) | n}]}; the message itself is "".
export function parseDefinition(text) {
  const types = {};
  text.split(/^={3,}\s*$/m).forEach((part, index) => {
    let name = '';
    const fields = [];
    for (const raw of part.split('\n')) {
      const line = raw.split('#')[0].trim();
      if (!line) continue;
      if (index > 0 && line.startsWith('MSG:')) {
        name = line.slice(4).trim();
        continue;
      }
      const match = /^([\w/]+)(?:\[(\d*)\])?\s+(\w+)\s*(=?)/.exec(line);
      if (!match || match[4]) continue;  // a constant
      let type = match[1];
      if (type === 'Header') type = 'std_msgs/Header';
      fields.push({name: match[3], type, array: match[2] === undefined ? undefined : Number(match[2])});
    }
    types[name] = fields;
  });
  const known = Object.keys(types);
  const resolve = (type, from) => {
    if (SIZES[type] || type === 'string') return type;
    if (types[type]) return type;
    const own = from.includes('/') ? `${from.split('/')[0]}/${type}` : '';
    const found = own && types[own] ? own : known.find((name) => name.endsWith(`/${type}`));
    if (!found) throw new Error(`type ${type} is not in the definition`);
    return found;
  };
  for (const name of known) for (const field of types[name]) field.type = resolve(field.type, name);
  return types;
}

const TEXT = new TextDecoder();

export class Decoder {
  constructor(definition) {
    this.types = parseDefinition(definition);
  }

  decode(view) {
    this.view = view;
    this.at = 0;
    return this.message(this.types['']);
  }

  take(bytes) {
    const at = this.at;
    if (at + bytes > this.view.byteLength) throw new Error('a message ends too early');
    this.at += bytes;
    return at;
  }

  message(fields) {
    const result = {};
    for (const {name, type, array} of fields) {
      result[name] = array === undefined ? this.value(type) : this.list(type, array);
    }
    return result;
  }

  value(type) {
    if (SIZES[type]) return READ[type](this.view, this.take(SIZES[type]));
    if (type === 'string') {
      const length = READ.uint32(this.view, this.take(4));
      return TEXT.decode(new Uint8Array(this.view.buffer, this.view.byteOffset + this.take(length), length));
    }
    return this.message(this.types[type]);
  }

  list(type, fixed) {
    const length = fixed || READ.uint32(this.view, this.take(4));
    const Typed = ARRAYS[type];
    if (Typed) {
      const start = this.view.byteOffset + this.take(length * Typed.BYTES_PER_ELEMENT);
      return Typed.BYTES_PER_ELEMENT === 1 ? new Typed(this.view.buffer, start, length)
        : new Typed(this.view.buffer.slice(start, start + length * Typed.BYTES_PER_ELEMENT));
    }
    const result = [];
    for (let i = 0; i < length; ++i) result.push(this.value(type));
    return result;
  }
}

// Writes what the page publishes.
export class Writer {
  constructor() {
    this.bytes = [];
  }

  number(set, size, value) {
    const view = new DataView(new ArrayBuffer(size));
    view[set](0, value, true);
    this.bytes.push(...new Uint8Array(view.buffer));
    return this;
  }

  uint32(value) { return this.number('setUint32', 4, value); }

  float64(value) { return this.number('setFloat64', 8, value); }

  text(value) {
    const bytes = new TextEncoder().encode(value);
    this.uint32(bytes.length).bytes.push(...bytes);
    return this;
  }
}

// geometry_msgs/PoseStamped. Without a heading the quaternion is 0: any.
export function poseStamped(frame, x, y, heading) {
  const writer = new Writer().uint32(0).uint32(0).uint32(0).text(frame).float64(x).float64(y).float64(0).float64(0)
    .float64(0);
  writer.float64(heading === undefined ? 0 : Math.sin(heading / 2));
  writer.float64(heading === undefined ? 0 : Math.cos(heading / 2));
  return new Uint8Array(writer.bytes);
}
