/** Recorded recordings that can be opened: their details, their health, and all of their samples. */
import type { ReplayStore } from "../recordings/replay-store";
import type { RecordingDetail } from "../wire/recording-types";
import { decode, type SampleFrame } from "../wire/codec";
import { HEADER } from "../wire/frame";
import { type Answers, bytesOf, recorded, type Recorded } from "./recorded";

const KNOWN: Recorded = recorded("recordings");

export function detailOf(id: string): RecordingDetail {
  return KNOWN.answers[`GET /api/recordings/${id}`] as RecordingDetail;
}

/** Each channel's frame of a message of samples. */
function framesIn(bytes: Uint8Array<ArrayBuffer>): ReadonlyMap<number, Uint8Array> {
  const found = new Map<number, Uint8Array>();
  const data = new DataView(bytes.buffer);
  for (let at = 0; at < bytes.length; ) {
    const size = data.getUint32(at + HEADER.size, true);
    found.set(data.getUint32(at + HEADER.channel, true), bytes.subarray(at, at + size));
    at += size;
  }
  return found;
}

/** All samples of a channel, by its device and name. */
export function samplesOf(id: string, device: string, name: string): SampleFrame {
  const { channels } = detailOf(id);
  const info = channels.find((one) => one.device === device && one.name === name);
  const dtypes: ReplayStore["dtypesOf"] = (channel) =>
    channels.find((one) => one.id === channel)?.columns.map(({ dtype }) => dtype);
  const { frames } = decode(bytesOf(KNOWN.windows?.[id] ?? "").buffer, dtypes);
  const found = frames.find(({ channel }) => channel === info?.id);
  if (found === undefined) throw new Error(`${id} has no ${name}`);
  return found;
}

/** The server's answers on recordings. Whatever range is asked for, all samples of its channels come: so few are never summarised. */
export function recordingAnswers(): Answers {
  const { answers, windows = {} } = KNOWN;
  const dynamic = Object.entries(windows).flatMap(([id, whole]) => {
    const place = `GET /api/recordings/${id}`;
    const frames = framesIn(bytesOf(whole));
    const window = (query: URLSearchParams): Response => {
      const parts = (query.get("channels") ?? "").split(",").flatMap((channel) => frames.get(Number(channel)) ?? []);
      return new Response(new Blob(parts as BlobPart[]), { headers: { "x-exact": "1" } });
    };
    const health = (query: URLSearchParams): unknown => answers[`${place}/health?device=${query.get("device")}`];
    return [
      [`${place}/window`, window],
      [`${place}/health`, health],
    ] as const;
  });
  return { ...answers, ...Object.fromEntries(dynamic) };
}
