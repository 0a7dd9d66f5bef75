/**
 * A synthetic device, for measuring and viewing without a server: seeded motion, encoded as on the wire and read by the page's own
 * codec. Not part of the page.
 */
import { decode, type SampleFrame } from "../wire/codec";
import { HEADER, HEADER_SIZE, OPCODE_SAMPLES } from "../wire/frame";
import type { BitsInfo, ChannelInfo, ColumnInfo, DeviceInfo, Dtype } from "../wire/types";
import { channelInfo, columnInfo } from "./fixtures";

const column = (
  name: string,
  dtype: Dtype,
  unit: string,
  axis: ColumnInfo["axis"] = "",
  more: Partial<ColumnInfo> = {},
): ColumnInfo => columnInfo({ name, dtype, unit, axis, ...more });
const bit = (name: string, low: number, more: Partial<BitsInfo> = {}): BitsInfo => ({
  name,
  low,
  width: 1,
  choices: {},
  severity: "",
  normal_set: false,
  doc: `${name}: what this bit means in one sentence.`,
  ...more,
});
const channel = (
  id: number,
  name: string,
  title: string,
  kind: ChannelInfo["kind"],
  unit: string,
  frame: string,
  columns: ColumnInfo[],
): ChannelInfo => channelInfo({ id, message: "Synthetic", name, title, kind, unit, frame, columns });
const xyz = (unit: string): ColumnInfo[] => (["x", "y", "z"] as const).map((axis) => column(axis, "f4", unit, axis));

export const DEVICE: DeviceInfo = {
  id: "1",
  name: "Synthetic",
  source: "synthetic",
  link: "simulator",
  status: "live",
  protocol: "",
  product: "",
  serial_number: "",
  firmware: "",
  protection: "",
  is_open: true,
  absent: [],
  key: "",
  own_name: "",
  resume: "",
  topic: "imu",
  former_name: "",
  quiet_since: null,
  simulated: false,
  unconfirmed_since: null,
  baud: null,
  message: "",
  hint: "",
  attempts: [],
  next_attempt: null,
  last_arrival: null,
  notices: [],
  rearm: [],
  required_action: "",
  decode_options: {},
  parent: "",
};

export const STATUS_BITS: readonly BitsInfo[] = [
  bit("FilterValid", 1, { severity: "error", normal_set: true }),
  bit("NoRotationUpdate", 3, { width: 2, choices: { 0: "not running", 2: "waiting", 3: "running" } }),
  bit("ClipAccZ", 10, { severity: "warning" }),
  bit("SyncIn", 21),
  bit("RtkStatus", 27, { width: 2, choices: { 0: "no RTK", 1: "floating", 2: "fixed" } }),
];

export const CHANNELS: readonly ChannelInfo[] = [
  channel(1, "Acceleration", "Acceleration", "vector", "m/s²", "", xyz("m/s²")),
  channel(2, "RateOfTurn", "Rate of turn", "vector", "°/s", "", xyz("°/s")),
  channel(3, "MagneticField", "Magnetic field", "vector", "a.u.", "", xyz("a.u.")),
  channel(
    4,
    "Quaternion",
    "Quaternion",
    "quaternion",
    "",
    "ENU from body",
    ["q0", "q1", "q2", "q3"].map((name, k) => column(name, "f4", "", (["w", "x", "y", "z"] as const)[k]!)),
  ),
  channel(5, "StatusWord", "Status word", "status", "", "", [column("value", "u4", "", "", { bits: STATUS_BITS })]),
  channel(6, "VelocityXYZ", "Velocity", "vector", "m/s", "ENU", xyz("m/s")),
  channel(7, "FreeAcceleration", "Free acceleration", "vector", "m/s²", "ENU", xyz("m/s²")),
  channel(8, "DeltaV", "Delta v", "vector", "m/s", "", xyz("m/s")),
  channel(9, "BaroPressure", "Pressure", "scalar", "Pa", "", [column("value", "u4", "Pa")]),
];

/** Same numbers every time: a linear congruential generator, sum of four for a bell. */
let seed = 7;
const uniform = (): number => (seed = (Math.imul(seed, 1_664_525) + 1_013_904_223) >>> 0) / 2 ** 32;
const noise = (): number => (uniform() + uniform() + uniform() + uniform() - 2) * 1.2;
const bump = (t: number, at: number, width: number): number => Math.exp(-(((t - at) / width) ** 2));

const D = Math.PI / 180;

/** All values of one channel at time t of a drive that repeats every 40 s. */
export function valuesAt(id: number, time: number): number[] {
  const t = time % 40;
  const rough = 0.1 + 0.9 * (0.5 - 0.5 * Math.cos((2 * Math.PI * t) / 40));
  const kerb = bump(t, 34, 0.1);
  const roll = 4 * Math.sin(t * 0.7) + 2 * Math.sin(t * 2.1) + 6 * kerb;
  const pitch = 3 * Math.sin(t * 0.5 + 1) - 5 * bump(t, 34.2, 0.15);
  const yaw = ((t * 18 + 180) % 360) - 180 + 8 * Math.sin(t * 0.9);
  const wave = (k: number): number => Math.sin(t * (1.1 + 0.7 * k) + k);
  switch (id) {
    case 1:
    case 7:
      return [wave(0) + noise() * rough, wave(1) * 0.7 + noise() * rough * 0.8, 9.81 + noise() * rough + 7 * kerb];
    case 2:
      return [
        10 * wave(1) + noise() * 4 * rough,
        6 * wave(2) + noise() * 4 * rough - 40 * kerb,
        18 + 12 * wave(0) + noise(),
      ];
    case 3:
      return [
        0.43 * Math.cos(yaw * D) + noise() * 0.003,
        0.43 * Math.sin(yaw * D) + noise() * 0.003,
        -0.88 + noise() * 0.003,
      ];
    case 4: {
      const [cr, sr, cp, sp, cy, sy] = [roll, pitch, yaw].flatMap((a) => [
        Math.cos((a * D) / 2),
        Math.sin((a * D) / 2),
      ]) as [number, number, number, number, number, number];
      return [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
      ];
    }
    case 5:
      return [
        2 |
          ((t < 8 ? 3 : 0) << 3) |
          (kerb > 0.5 ? 1 << 10 : 0) |
          (t % 1 < 0.01 ? 1 << 21 : 0) |
          ((t > 22 && t < 25 ? 1 : 2) << 27),
      ];
    case 9:
      return [101_325 + 30 * wave(0) + noise()];
    default:
      return [wave(0) * 1.5 + noise() * 0.02, wave(1) + noise() * 0.02, 0.2 * wave(2) + noise() * 0.02];
  }
}

/** One frame as the wire carries it, read back by the codec. */
export function frameOf(info: ChannelInfo, sequence: number, times: Float64Array, history: boolean): SampleFrame {
  const n = times.length;
  const arrays = info.columns.map(({ dtype }) => (dtype === "u4" ? new Uint32Array(n) : new Float32Array(n)));
  for (let i = 0; i < n; i++) valuesAt(info.id, times[i]!).forEach((value, c) => (arrays[c]![i] = value));
  const columns = [times.map((t) => t + 0.002), times, ...arrays];
  const size = columns.reduce((sum, { byteLength }) => sum + ((byteLength + 7) & ~7), HEADER_SIZE);
  const buffer = new ArrayBuffer(size);
  const data = new DataView(buffer);
  data.setUint8(HEADER.opcode, OPCODE_SAMPLES);
  data.setUint8(HEADER.flags, history ? 1 : 0);
  data.setUint16(HEADER.columns, columns.length, true);
  data.setUint32(HEADER.channel, info.id, true);
  data.setUint32(HEADER.n, n, true);
  data.setBigUint64(HEADER.sequence, BigInt(sequence), true);
  data.setUint32(HEADER.size, size, true);
  data.setFloat64(HEADER.now, times[n - 1] ?? 0, true);
  let at = HEADER_SIZE;
  for (const array of columns) {
    new Uint8Array(buffer).set(new Uint8Array(array.buffer, array.byteOffset, array.byteLength), at);
    at += (array.byteLength + 7) & ~7;
  }
  const { frames, problem } = decode(buffer, () => info.columns.map(({ dtype }) => dtype));
  if (frames[0] === undefined) throw new Error(problem);
  return frames[0];
}
