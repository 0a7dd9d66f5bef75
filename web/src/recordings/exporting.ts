/** What can be exported of a recording, and how large will it be, about? Pure; the figures are said before anything is written. */
import { DTYPE_SIZE } from "../wire/types";
import type { ExportFormat, RecordingDetail, RecordingInfo } from "./types";

export interface FormatInfo {
  readonly name: ExportFormat;
  readonly title: string;
  readonly words: string;
  /** Holds the bytes of one device, and no choice of channels. */
  readonly single: boolean;
  /** Only of devices that speak this; "" for any. */
  readonly protocol: string;
}

export const FORMATS: readonly FormatInfo[] = [
  { name: "csv", title: "CSV", words: "full precision, units, one table per message", single: false, protocol: "" },
  { name: "csv-aligned", title: "CSV, one table", words: "rows aligned to the fastest message", single: false, protocol: "" },
  { name: "parquet", title: "Parquet", words: "one table per message", single: false, protocol: "" },
  { name: "mcap", title: "MCAP", words: "decoded, with schemas, for other viewers", single: false, protocol: "" },
  { name: "rrd", title: "RRD", words: "for the Rerun viewer", single: false, protocol: "" },
  { name: "mtb", title: "MTB", words: "for the vendor's MT programs", single: true, protocol: "xbus" },
  { name: "raw", title: "RAW", words: "for the vendor's Inertial Sense tools", single: true, protocol: "isb" },
  { name: "bytes", title: "Bytes", words: "as they came", single: true, protocol: "" },
];

/** Formats that the devices of a recording allow. */
export function formatsOf(info: Pick<RecordingInfo, "devices">): readonly FormatInfo[] {
  return FORMATS.filter(({ protocol }) => protocol === "" || info.devices.some((device) => device.protocol === protocol));
}

/** Devices whose bytes a format can hold. */
export function devicesFor(info: Pick<RecordingInfo, "devices">, format: FormatInfo): RecordingInfo["devices"] {
  return info.devices.filter(({ protocol }) => format.protocol === "" || protocol === format.protocol);
}

/** Characters of a number in CSV with its comma; of the two times of a row. */
const CSV_NUMBER = 11;
const CSV_TIMES = 36;
/** What is left of plain columns after packing. Measured on recordings of twins; of real noise rather more. */
const PACKED = 0.6;

/**
 * About how many bytes an export has.
 *
 * @param seconds how much of the recording, s
 * @param channels ids; undefined: all
 */
export function sizeOf(format: ExportFormat, info: Pick<RecordingInfo, "size" | "duration">, detail: Sampled | undefined, seconds: number, channels: readonly number[] | undefined): number {
  const share = info.duration !== null && info.duration > 0 ? Math.min(1, seconds / info.duration) : 1;
  if (format === "bytes" || format === "raw" || format === "mtb") return info.size * share;
  if (detail === undefined) return info.size * share * (format.startsWith("csv") ? 2.7 : 1);
  let [text, plain] = [0, 0];
  for (const { id, columns, kind } of detail.channels) {
    const usual = detail.longest_s[String(id)] ?? 0;
    if (usual <= 0 || (channels !== undefined && !channels.includes(id))) continue;
    const rows = seconds / usual;
    text += rows * ((kind === "rows" ? 0 : CSV_TIMES) + CSV_NUMBER * columns.length);
    plain += rows * (16 + columns.reduce((sum, { dtype }) => sum + DTYPE_SIZE[dtype], 0));
  }
  return format.startsWith("csv") ? text : plain * PACKED;
}

type Sampled = Pick<RecordingDetail, "longest_s"> & { readonly channels: readonly Pick<RecordingDetail["channels"][number], "id" | "kind" | "columns">[] };
