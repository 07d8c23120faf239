// Reads recordings with Foxglove's own libraries. Each line of the input is the path of an MCAP file; the answer is a
// line of JSON: [topic, [log time, publish time, sequence], values] for each message, or {error}. Structs are lists of
// their fields, integers of 64 bits and floats that JSON lacks are texts.

import { readFile } from "node:fs/promises";
import { createInterface } from "node:readline";
import { McapIndexedReader } from "@mcap/core";
import idl from "@foxglove/omgidl-parser";
import omg from "@foxglove/omgidl-serialization";
import msg from "@foxglove/rosmsg";
import ros from "@foxglove/rosmsg2-serialization";
import lz4 from "@foxglove/wasm-lz4";
import zstd from "@foxglove/wasm-zstd";
import { protobufFromBinaryDescriptor } from "@mcap/support";

const text = (octets) => new TextDecoder().decode(octets);

const readers = {
  ros2msg: (name, schema) => new ros.MessageReader(msg.parse(text(schema), { ros2: true })),
  omgidl: (name, schema) => new omg.MessageReader(name, idl.parseIDL(text(schema))),
  protobuf: (name, schema) => {
    const type = protobufFromBinaryDescriptor(schema).lookupType(name);
    const fields = [...type.fieldsArray].sort((one, other) => one.id - other.id);
    return {
      readMessage: (octets) => {
        const found = type.toObject(type.decode(octets), { defaults: true, longs: String });
        return fields.map((each) => found[each.name]);
      },
    };
  },
};

const listed = (value) => {
  if (typeof value === "bigint") return String(value);
  if (typeof value === "number") return Number.isFinite(value) && !Object.is(value, -0) ? value : Object.is(value, -0) ? "-0" : String(value);
  if (value === null || typeof value !== "object") return value;
  if (Array.isArray(value) || ArrayBuffer.isView(value)) return Array.from(value, listed);
  return "structure_needs_at_least_one_member" in value ? [] : Object.values(value).map(listed);
};

const messages = async (path) => {
  const octets = await readFile(path);
  const readable = {
    size: async () => BigInt(octets.length),
    read: async (offset, size) => new Uint8Array(octets.subarray(Number(offset), Number(offset + size))),
  };
  const decompressHandlers = {
    lz4: (data, size) => lz4(data, Number(size)),
    zstd: (data, size) => zstd.decompress(data, Number(size)),
  };
  const file = await McapIndexedReader.Initialize({ readable, decompressHandlers });
  const known = new Map();
  const found = [];
  for await (const each of file.readMessages({ validateCrcs: true })) {
    const channel = file.channelsById.get(each.channelId);
    if (!known.has(channel.id)) {
      const schema = file.schemasById.get(channel.schemaId);
      known.set(channel.id, readers[schema.encoding](schema.name, schema.data));
    }
    const times = [String(each.logTime), String(each.publishTime), each.sequence];
    found.push([channel.topic, times, listed(known.get(channel.id).readMessage(each.data))]);
  }
  return found;
};

await Promise.all([lz4.isLoaded, zstd.isLoaded]);
for await (const path of createInterface({ input: process.stdin })) {
  console.log(JSON.stringify(await messages(path).catch((error) => ({ error: `${error.stack}` }))));
}
