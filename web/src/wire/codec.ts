/**
 * Decoder of binary WebSocket messages. (The specification is the docstring of server/wire/.)
 *
 *     | sample frame | sample frame | …            a message is frames back to back
 *
 *      0  u8  opcode   1  u8 flags   2  u16 columns   4  u32 channel   8  u32 n   12  u32 dropped
 *     16  u64 sequence            24  u32 size      28  u32 –         32  f64 now
 *     40  arrival f8[n] · time f8[n] · the channel's columns, each padded to a multiple of 8 bytes
 *
 * A column is a typed-array view of the message itself: nothing is copied, and when the message's buffer is transferred to another
 * thread the views travel with it. Typed arrays read in the machine's byte order; every machine that runs a browser today is
 * little-endian, which `decode` checks once.
 *
 * Every length is checked before use. An inconsistent message gives the frames before the fault and one sentence about it: the page
 * shows the sentence and continues, because the next message is independent.
 */
import { DTYPE_SIZE, FLAG_HISTORY, HEADER, HEADER_SIZE, OPCODE_SAMPLES } from "./frame";
import type { Dtype } from "./types";
import { TEXT } from "./texts";

export type Column =
  | Float32Array
  | Float64Array
  | Int8Array
  | Uint8Array
  | Int16Array
  | Uint16Array
  | Int32Array
  | Uint32Array
  | BigInt64Array
  | BigUint64Array;

/** n samples of one channel. */
export interface SampleFrame {
  readonly channel: number;
  readonly n: number;
  /** Samples of this channel dropped for this browser just before these. */
  readonly dropped: number;
  /** Number of the first sample since the channel exists. */
  readonly sequence: number;
  /** Sent because of a subscribe: older than live samples, to be put before them. */
  readonly history: boolean;
  /** Server clock when sent, unix seconds. */
  readonly now: number;
  /** (n,) unix seconds at which the bytes arrived at the host. */
  readonly arrival: Float64Array;
  /** (n,) device time as unix seconds; NaN where there is no device clock. */
  readonly time: Float64Array;
  /** (n,) each, in the advertised order and dtypes. */
  readonly columns: readonly Column[];
}

export interface Decoded {
  readonly frames: readonly SampleFrame[];
  /** The fault in the rest of the message, or undefined. */
  readonly problem: string | undefined;
}

/** A view of `n` values at byte `at`, without a copy. `at` must be a multiple of the value's size (ensured by the wire's padding). */
function view(dtype: Dtype, buffer: ArrayBuffer, at: number, n: number): Column {
  switch (dtype) {
    case "f4":
      return new Float32Array(buffer, at, n);
    case "f8":
      return new Float64Array(buffer, at, n);
    case "i1":
      return new Int8Array(buffer, at, n);
    case "u1":
      return new Uint8Array(buffer, at, n);
    case "i2":
      return new Int16Array(buffer, at, n);
    case "u2":
      return new Uint16Array(buffer, at, n);
    case "i4":
      return new Int32Array(buffer, at, n);
    case "u4":
      return new Uint32Array(buffer, at, n);
    case "i8":
      return new BigInt64Array(buffer, at, n);
    case "u8":
      return new BigUint64Array(buffer, at, n);
  }
}

const LITTLE_ENDIAN = new Uint8Array(new Uint16Array([1]).buffer)[0] === 1;

/** Bytes that `n` values of `dtype` take on the wire. */
function padded(dtype: Dtype, n: number): number {
  return (n * DTYPE_SIZE[dtype] + 7) & ~7;
}

/** One frame at byte `at`, or a sentence about its fault. */
function frame(
  buffer: ArrayBuffer,
  data: DataView,
  at: number,
  dtypesOf: (channel: number) => readonly Dtype[] | undefined,
): { readonly frame: SampleFrame; readonly size: number } | string {
  const left = buffer.byteLength - at;
  if (left < HEADER_SIZE) return TEXT.headerCut(left, HEADER_SIZE);
  const opcode = data.getUint8(at + HEADER.opcode);
  if (opcode !== OPCODE_SAMPLES) return TEXT.unknownOpcode(opcode);
  const size = data.getUint32(at + HEADER.size, true);
  if (size < HEADER_SIZE || size % 8 !== 0) return TEXT.invalidLength(size);
  if (size > left) return TEXT.frameCut(size, left);
  const channel = data.getUint32(at + HEADER.channel, true);
  const dtypes = dtypesOf(channel);
  if (dtypes === undefined) return TEXT.unknownChannel(channel);
  const count = data.getUint16(at + HEADER.columns, true);
  if (count !== dtypes.length + 2) return TEXT.wrongColumnCount(channel, dtypes.length + 2, count);
  const n = data.getUint32(at + HEADER.n, true);
  let need = HEADER_SIZE + 2 * padded("f8", n);
  for (const dtype of dtypes) need += padded(dtype, n);
  // n is checked against its size before any view is made: 2³² − 1 rows of garbage must not allocate or throw
  if (n > size || need !== size) return TEXT.samplesCut(n, channel, need, size);

  let place = at + HEADER_SIZE;
  const arrival = new Float64Array(buffer, place, n);
  place += padded("f8", n);
  const time = new Float64Array(buffer, place, n);
  place += padded("f8", n);
  const columns: Column[] = [];
  for (const dtype of dtypes) {
    columns.push(view(dtype, buffer, place, n));
    place += padded(dtype, n);
  }
  return {
    size,
    frame: {
      channel,
      n,
      dropped: data.getUint32(at + HEADER.dropped, true),
      sequence: Number(data.getBigUint64(at + HEADER.sequence, true)),
      history: (data.getUint8(at + HEADER.flags) & FLAG_HISTORY) !== 0,
      now: data.getFloat64(at + HEADER.now, true),
      arrival,
      time,
      columns,
    },
  };
}

/**
 * The sample frames of one binary message.
 *
 * @param buffer the message; it must start at an address divisible by 8, as every ArrayBuffer does
 * @param dtypesOf the advertised dtypes of a channel's own columns; undefined for a channel never advertised
 * @returns the frames up to the first fault, and the fault in words
 */
export function decode(buffer: ArrayBuffer, dtypesOf: (channel: number) => readonly Dtype[] | undefined): Decoded {
  const frames: SampleFrame[] = [];
  if (!LITTLE_ENDIAN) return { frames, problem: TEXT.bigEndian };
  const data = new DataView(buffer);
  let at = 0;
  while (at < buffer.byteLength) {
    const found = frame(buffer, data, at, dtypesOf);
    if (typeof found === "string") return { frames, problem: TEXT.unreadableSamples(at, found) };
    frames.push(found.frame);
    at += found.size;
  }
  return { frames, problem: undefined };
}
