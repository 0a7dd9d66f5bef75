/**
 * Foxglove's own client of its WebSocket protocol, as far as a plot needs it: what is advertised, and some messages of one topic.
 *
 *   node web/tests/foxglove.mjs ws://HOST:PORT/foxglove TOPIC COUNT
 *
 * Prints one JSON object: {server, topics, channel, messages: [{at (ns, as text), value}]}. tests/server/extensions/foxglove/test_foxglove.py
 * reads it.
 */
import { createRequire } from "node:module";

const { FoxgloveClient } = createRequire(import.meta.url)("@foxglove/ws-protocol");

const [address, topic, count] = process.argv.slice(2);
const client = new FoxgloveClient({
  ws: new WebSocket(address, [FoxgloveClient.SUPPORTED_SUBPROTOCOL, "foxglove.sdk.v1"]),
});
const topics = [];
const messages = [];
let server;
let channel;

client.on("serverInfo", (info) => (server = info));
client.on("error", (error) => fail(error.message ?? "the connection failed"));
client.on("close", ({ code }) => fail(`closed with ${code}`));
client.on("advertise", (channels) => {
  for (const one of channels) {
    topics.push(one.topic);
    if (one.topic !== topic || channel) continue;
    channel = one;
    client.subscribe(one.id);
  }
});
client.on("message", ({ timestamp, data }) => {
  messages.push({ at: String(timestamp), value: JSON.parse(new TextDecoder().decode(data)) });
  if (messages.length < Number(count)) return;
  console.log(JSON.stringify({ server, topics, channel, messages }));
  process.exit(0);
});

function fail(words) {
  console.error(words);
  process.exit(1);
}
