// A client of others: npm's @foxglove/ws-protocol, with @foxglove/rosmsg and @foxglove/rosmsg-serialization.
// node foreign_client.js ADDRESS TOKEN TOPIC...: prints as JSON what the topics brought, a parameter, a service's answer,
// and what came of a wrong token.
const {FoxgloveClient} = require('@foxglove/ws-protocol');
const {parse} = require('@foxglove/rosmsg');
const {MessageReader} = require('@foxglove/rosmsg-serialization');
const WebSocket = require('ws');

const [, , address, token, ...topics] = process.argv;
const open = (query, name) => new WebSocket(address + query, [name]);
const plain = (_, value) => {
  if (typeof value === 'bigint' || Number.isNaN(value)) return String(value);
  if (ArrayBuffer.isView(value)) return [...value];
  return value && typeof value === 'object' && Object.keys(value).join() === 'sec,nsec' ? value.sec + value.nsec * 1e-9
    : value;
};

function messages(client) {
  const channels = new Map();
  const readers = new Map();
  const found = {};
  client.on('advertise', (added) => {
    for (const channel of added) {
      if (!topics.includes(channel.topic)) continue;
      channels.set(client.subscribe(channel.id), channel);
      readers.set(channel.topic, new MessageReader(parse(channel.schema)));
    }
  });
  return new Promise((resolve) => client.on('message', ({subscriptionId, data}) => {
    const {topic} = channels.get(subscriptionId);
    found[topic] = found[topic] || readers.get(topic).readMessage(data);
    if (Object.keys(found).length === topics.length) resolve(found);
  }));
}

function parameter(client) {
  return new Promise((resolve) => {
    client.on('parameterValues', ({parameters}) => resolve(parameters[0].value));
    client.on('serverInfo', () => client.getParameters(['/web_test/foreign'], 'p'));
  });
}

function service(client) {
  return new Promise((resolve, reject) => {
    client.on('advertiseServices', (services) => {
      const stop = services.find(({name}) => name === '/command/stop');
      if (!stop) return;
      client.on('serviceCallResponse', ({data}) => resolve(new MessageReader(parse(stop.responseSchema)).readMessage(data)));
      client.on('serviceCallFailure', ({message}) => reject(new Error(message)));
      client.sendServiceCallRequest({serviceId: stop.id, callId: 1, encoding: 'ros1', data: new DataView(new ArrayBuffer(0))});
    });
  });
}

function refusal(query) {
  return new Promise((resolve) => open(query, 'foxglove.websocket.v1').on('error', (error) => resolve(error.message))
    .on('open', () => resolve('open')));
}

async function main() {
  const client = new FoxgloveClient({ws: open(`?token=${token}`, FoxgloveClient.SUPPORTED_SUBPROTOCOL)});
  const newer = open('', 'foxglove.sdk.v1');
  const both = new Promise((resolve) => newer.on('open', () => resolve(newer.protocol)));
  const [values, value, answer, protocol, refused] = await Promise.all(
    [messages(client), parameter(client), service(client), both, refusal('?token=wrong')]);
  process.stdout.write(JSON.stringify({values, value, answer, protocol, refused}, plain), () => process.exit(0));
}

main().catch((error) => {
  console.error(error);
  process.exit(1);
});
