/** Numbers of the wire, as in server/wire/__init__.py (tests/server/wire/test_wire.py compares them). */

export const SUBPROTOCOL = "imuscope.v1";
export const OPCODE_SAMPLES = 1;
/** Bit of `flags`: history. Prepend it; the newest block is sent first, live frames may come between. */
export const FLAG_HISTORY = 1;
/** Size of a sample frame's header in bytes; the columns follow. */
export const HEADER_SIZE = 40;
/** Offset of each header field in a frame, in bytes (u8, u8, u16, u32, u32, u32, u64, u32, f64). */
export const HEADER = {
  opcode: 0,
  flags: 1,
  columns: 2,
  channel: 4,
  n: 8,
  dropped: 12,
  sequence: 16,
  size: 24,
  now: 32,
} as const;
/** Bytes of one value of each dtype. */
export const DTYPE_SIZE = {
  f4: 4,
  f8: 8,
  i1: 1,
  u1: 1,
  i2: 2,
  u2: 2,
  i4: 4,
  u4: 4,
  i8: 8,
  u8: 8,
} as const;
