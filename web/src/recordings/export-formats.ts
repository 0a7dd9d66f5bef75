/** Export formats of a recording, and the approximate size of an export. Pure; sizes are shown before anything is written. */
import type { ExportCapability } from "../wire/capability-types";
import type { ExportSizes, RecordingInfo } from "../wire/recording-types";

/** The formats that the devices of a recording allow. */
export function formatsOf(
  formats: readonly ExportCapability[],
  info: Pick<RecordingInfo, "devices">,
): readonly ExportCapability[] {
  return formats.filter(
    ({ protocol }) => protocol === "" || info.devices.some((device) => device.protocol === protocol),
  );
}

/** Devices whose bytes a format can hold. */
export function devicesFor(info: Pick<RecordingInfo, "devices">, format: ExportCapability): RecordingInfo["devices"] {
  return info.devices.filter(({ protocol }) => format.protocol === "" || protocol === format.protocol);
}

/** The size of an export, and whether that was measured on this recording. */
export interface Size {
  readonly bytes: number;
  readonly measured: boolean;
}

/**
 * Approximate bytes of an export. Until measured, by the size per byte of a driving recording; one at rest compresses far better.
 *
 * @param seconds exported part of the recording, s
 * @param device whose bytes they are, if a format holds those of one
 * @param measured the server's result for this range and these channels; undefined before its answer
 */
export function sizeOf(
  format: ExportCapability,
  info: Pick<RecordingInfo, "size" | "duration">,
  seconds: number,
  device: string | undefined,
  measured: ExportSizes | undefined,
): Size {
  const found = format.single ? measured?.devices[device ?? ""] : measured?.sizes[format.name];
  if (found !== undefined) return { bytes: found, measured: true };
  const share = info.duration !== null && info.duration > 0 ? Math.min(1, seconds / info.duration) : 1;
  return { bytes: info.size * share * format.per_byte, measured: false };
}
