// Recordings of ROS 1 (bag format 2.0, not compressed), as the recorder writes them.

const MAGIC = '#ROSBAG V2.0\n';
const [MESSAGE, CHUNK, CONNECTION] = [0x02, 0x05, 0x07];
const TEXT = new TextDecoder();

// {connections: [{topic, type, definition}], messages: [{time [s], connection, view}] by time}. A file that ends early,
// as after a power cut, gives what is there. Throws an Error for what is no such file.
export function readBag(buffer) {
  const bytes = new Uint8Array(buffer);
  if (TEXT.decode(bytes.subarray(0, MAGIC.length)) !== MAGIC) throw new Error('this is no bag of format 2.0');
  const connections = new Map();
  const messages = [];
  readRecords(buffer, MAGIC.length, buffer.byteLength, connections, messages);
  messages.sort((a, b) => a.time - b.time);
  return {connections: [...connections.values()], messages};
}

function readRecords(buffer, start, end, connections, messages) {
  const view = new DataView(buffer);
  for (let at = start; at + 8 <= end;) {
    const headerEnd = at + 4 + view.getUint32(at, true);
    if (headerEnd + 4 > end) return;
    const header = fieldsOf(buffer, at + 4, headerEnd);
    const data = headerEnd + 4;
    const next = data + view.getUint32(headerEnd, true);
    if (next > end) return;
    const op = header.op.getUint8(0);
    if (op === CHUNK) {
      const compression = text(header.compression);
      if (compression !== 'none') throw new Error(`the bag is compressed (${compression}): rosbag decompress it`);
      readRecords(buffer, data, next, connections, messages);
    } else if (op === CONNECTION) {
      const about = fieldsOf(buffer, data, next);
      connections.set(header.conn.getUint32(0, true),
        {topic: text(header.topic), type: text(about.type), definition: text(about.message_definition)});
    } else if (op === MESSAGE) {
      messages.push({time: header.time.getUint32(0, true) + header.time.getUint32(4, true) * 1e-9,
        connection: connections.get(header.conn.getUint32(0, true)), view: new DataView(buffer, data, next - data)});
    }
    at = next;
  }
}

const text = (view) => TEXT.decode(view);

function fieldsOf(buffer, start, end) {
  const view = new DataView(buffer);
  const fields = {};
  for (let at = start; at + 4 <= end;) {
    const next = at + 4 + view.getUint32(at, true);
    const equals = new Uint8Array(buffer).indexOf(0x3d, at + 4);
    if (next > end || equals < 0 || equals >= next) throw new Error('a record of the bag is damaged');
    fields[TEXT.decode(new Uint8Array(buffer, at + 4, equals - at - 4))] = new DataView(buffer, equals + 1, next - equals - 1);
    at = next;
  }
  return fields;
}
