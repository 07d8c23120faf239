// Hears and asks the sonar of docs/guides/native.md, by what docs/reference/protocol-zeromq.md says.
//     node talk.mjs RUN_TIME_FOLDER CHANNELS_JSON
import { randomBytes } from "node:crypto";
import { readFileSync, readdirSync } from "node:fs";
import { ExtensionCodec, decode, encode } from "@msgpack/msgpack";
import { Dealer, Subscriber } from "zeromq";

const [folder, list] = process.argv.slice(2);
const channels = JSON.parse(readFileSync(list, "utf8")).channels;
const members = readdirSync(`${folder}/zeromq`).filter((name) => name.endsWith(".json"));
const entries = members.flatMap((name) => JSON.parse(readFileSync(`${folder}/zeromq/${name}`, "utf8")).entries);
const address = (role, channel) => entries.find((each) => each.role === role && each.channel === channel).address;

const arrays = new ExtensionCodec();
const pack = (value) => (value instanceof Float32Array ? Buffer.concat([Buffer.from("f"), Buffer.from(value.buffer)]) : null);
const unpack = (data) => (data[0] === 0x66 ? new Float32Array(data.slice(1).buffer) : data);
arrays.register({ type: 1, encode: pack, decode: unpack });

const topic = new Subscriber({ connectTimeout: 5000, receiveTimeout: 10000 });
topic.subscribe(Buffer.from("sonar/SonarPub/nearest\0"));
topic.connect(address("publishes", "sonar/SonarPub/nearest"));
const [message] = await topic.receive();
const [[distance, quality]] = decode(message.subarray(message.indexOf(0) + 1 + 33), { useBigInt64: true });
console.log(`heard ${distance.toFixed(1)} m, quality ${quality}`);

const server = new Dealer({ receiveTimeout: 10000 });
server.connect(address("serves", "sonar/Sonar/scan"));
const client = randomBytes(8).readBigUInt64LE();
const { fingerprint } = channels.find((each) => each.channel === "sonar/Sonar/scan");
for (const [sequence, angles] of [[1n, [0, 0.5]], [2n, [2]]]) {
    const header = Buffer.alloc(30);
    header.writeUInt8(1, 0);
    header.writeBigUInt64LE(BigInt(`0x${fingerprint}`), 2);
    header.writeBigUInt64LE(client, 10);
    header.writeBigUInt64LE(sequence, 18);
    header.writeUInt32LE(5000, 26);
    const payload = encode([new Float32Array(angles)], { extensionCodec: arrays });
    await server.send(Buffer.concat([Buffer.from("sonar/Sonar/scan\0"), header, payload]));
    const [reply] = await server.receive();
    const values = decode(reply.subarray(26), { useBigInt64: true, extensionCodec: arrays });
    if (reply[1] === 0) console.log(`scanned ${values[0].map((echo) => echo[0].toFixed(2)).join(", ")}`);
    else console.log(`status ${reply[1]}: ${values.join(", ")}`);
}
topic.close();
server.close();
