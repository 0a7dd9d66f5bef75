/** What can be exported of a recording, and how large will it be, about? Pure; the figures are said before anything is written. */
import type { ExportFormat, ExportSizes, RecordingInfo } from "./types";

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

/** Of a recording of drives, what a format takes for each byte of the recording's file. Packs far better at rest: measured sizes replace this. */
const PER_BYTE: Readonly<Record<ExportFormat, number>> = { csv: 1.4, "csv-aligned": 4.4, parquet: 1.3, mcap: 4.4, rrd: 4.4, mtb: 1, raw: 1, bytes: 1 };

/** The size of an export, and whether that was measured on this recording. */
export interface Size {
  readonly bytes: number;
  readonly measured: boolean;
}

/**
 * About how many bytes an export has.
 *
 * @param seconds how much of the recording, s
 * @param device whose bytes they are, where a format holds those of one
 * @param measured what the server found of this stretch and these channels; undefined before it has answered
 */
export function sizeOf(format: FormatInfo, info: Pick<RecordingInfo, "size" | "duration">, seconds: number, device: string | undefined, measured: ExportSizes | undefined): Size {
  const found = format.single ? measured?.devices[device ?? ""] : measured?.sizes[format.name];
  if (found !== undefined) return { bytes: found, measured: true };
  const share = info.duration !== null && info.duration > 0 ? Math.min(1, seconds / info.duration) : 1;
  return { bytes: info.size * share * PER_BYTE[format.name], measured: false };
}
