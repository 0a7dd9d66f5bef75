/** Export dialog: range, format, channels; duration and size are shown before anything is written. */
import { useSignal } from "@preact/signals";
import { bytes, length, recordingTitle } from "../../recordings/library-filter";
import { recordingsApi } from "../../recordings/api";
import type { ExportJobRequest, ExportSizes, RecordingDetail, RecordingInfo } from "../../wire/recording-types";
import { Button } from "../../ui/controls/button";
import { Segmented, Select } from "../../ui/controls/choices";
import { Dialog } from "../../ui/controls/dialog";
import { span } from "../../ui/format/format";
import type { HttpProblem } from "../../requests/http";
import { ProblemNote } from "../../requests/problem-note";
import { useAnswer } from "../../requests/use-answer";
import { capabilities } from "../../wire/capabilities";
import type { ExportCapability } from "../../wire/capability-types";
import type { App } from "../../page/context";
import { Jobs } from "./export-jobs";
import { type Exporting, exportingOf, type ExportRange, takeExport } from "../../recordings/exporting";
import { COMMON } from "../../texts/common";
import { TEXT } from "../../texts/recordings";
import "./export.css";

export function ExportDialog({ app, of }: { readonly app: App; readonly of: Exporting }) {
  const { info, detail, ranges, first, base } = of;
  const formats = formatsOf(capabilities.value.exports, info);
  const format = useSignal<ExportCapability | undefined>(formats[0]);
  const range = useSignal<ExportRange | undefined>(of.chosen);
  const left = useSignal<ReadonlySet<number>>(new Set());
  const device = useSignal("");
  const units = useSignal<ExportJobRequest["units"]>("shown");
  const busy = useSignal(false);
  const problem = useSignal<HttpProblem | undefined>(undefined);
  const chosen = format.value;
  const channels =
    !chosen || chosen.single || left.value.size === 0
      ? undefined
      : (detail?.channels.map(({ id }) => id).filter((id) => !left.value.has(id)) ?? undefined);
  const measured = useMeasured(of, range.value, channels);
  if (!chosen) return null;
  const devices = devicesFor(info, chosen);
  const hasUnits = chosen.takes_units && !!detail?.channels.some(({ columns }) => columns.some((one) => one.sent_unit));
  const only = chosen.single ? (devices.find(({ id }) => id === device.value) ?? devices[0]) : undefined;
  const seconds = range.value ? range.value.t1 - range.value.t0 : (info.duration ?? 0);
  const size = (one: ExportCapability): string => {
    const device = devicesFor(info, one).find(({ id }) => id === only?.id) ?? devicesFor(info, one)[0];
    const { bytes: found, measured: isMeasured } = sizeOf(one, info, seconds, device?.id, measured);
    const { value, unit } = bytes(found);
    return isMeasured ? TEXT.about(value, unit) : TEXT.roughly(value, unit);
  };
  const go = async (): Promise<void> => {
    busy.value = true;
    const outcome = await recordingsApi.export(info.id, {
      format: chosen.name,
      t0: range.value?.t0 ?? null,
      t1: range.value?.t1 ?? null,
      channels: channels ?? null,
      device: only?.id ?? "",
      base,
      units: hasUnits ? units.value : "shown",
    });
    problem.value = outcome.ok ? undefined : outcome.problem;
    if (outcome.ok) takeExport(app)(outcome.value);
    busy.value = false;
  };
  const n = channels?.length ?? detail?.channels.length;
  return (
    <Dialog title={TEXT.exportRecording(recordingTitle(info))} onClose={() => (exportingOf(app).value = undefined)}>
      <div class="export">
        {ranges.length > 0 && (
          <Segmented
            label={TEXT.part}
            class="full-width"
            value={range.value?.name ?? ""}
            options={[["", TEXT.whole], ...ranges.map(({ name }) => [name, name] as const)]}
            onChoose={(name) => (range.value = ranges.find((one) => one.name === name))}
          />
        )}
        <p class="dim">
          {range.value
            ? TEXT.rangeThen(length(range.value.t0 - first, 1), length(range.value.t1 - first, 1))
            : TEXT.fromStartToEnd}
          {lengthWords(seconds)}
          {n !== undefined && !chosen.single ? TEXT.thenChannels(n) : ""}
          {base === "device" ? TEXT.byDeviceTime : TEXT.byArrivalTime}
        </p>
        <div class="formats" role="radiogroup" aria-label={TEXT.format}>
          {formats.map((one) => (
            <label key={one.name} class={one === chosen ? "on" : ""}>
              <input type="radio" name="format" checked={one === chosen} onChange={() => (format.value = one)} />
              <b>{one.title}</b>
              <small>{one.words}</small>
              <span class="num">{size(one)}</span>
            </label>
          ))}
        </div>
        {chosen.single && devices.length > 1 && (
          <Select
            words={COMMON.device}
            label={COMMON.device}
            value={only?.id ?? ""}
            options={devices.map((one) => [one.id, `${one.product || one.name} ${one.serial_number}`])}
            onChoose={(id) => (device.value = id)}
          />
        )}
        {hasUnits && (
          <Select
            words={TEXT.units}
            label={TEXT.units}
            value={units.value}
            options={(["shown", "SI", "device"] as const).map((one) => [one, TEXT.unitsOf[one]] as const)}
            onChoose={(one) => (units.value = one)}
          />
        )}
        {!chosen.single && detail && <Channels detail={detail} left={left} />}
        <Button
          changes
          look="main start-export"
          icon="download"
          words={TEXT.exportAs(chosen.title, size(chosen))}
          disabled={busy.value || channels?.length === 0}
          onClick={() => void go()}
        />
        {problem.value && <ProblemNote problem={problem.value} />}
        <Jobs app={app} recording={info.id} />
      </div>
    </Dialog>
  );
}

/** Delay before measuring, so that choosing several channels measures once. */
const MEASURE_AFTER_MS = 300;

/** Sizes measured by the server for that range and those channels; undefined until known. A recording that needs decoding is not measured.
 */
function useMeasured(
  { info, detail, base }: Exporting,
  range: ExportRange | undefined,
  channels: readonly number[] | undefined,
): ExportSizes | undefined {
  const selection = { t0: range?.t0 ?? null, t1: range?.t1 ?? null, channels: channels ?? null, base };
  const canAsk = (info.opened || detail !== undefined) && channels?.length !== 0;
  const question = canAsk ? JSON.stringify([info.id, selection]) : "";
  const found = useAnswer(question, () => recordingsApi.exportSizes(info.id, selection), {
    typedMs: MEASURE_AFTER_MS,
  });
  return found.isOld ? undefined : found.answer;
}

function lengthWords(seconds: number): string {
  const { value, unit } = span(seconds);
  return seconds < 60 ? `${value} ${unit}` : `${length(seconds)} ${seconds < 3600 ? "min" : "h"}`;
}

function Channels({
  detail,
  left,
}: {
  readonly detail: RecordingDetail;
  readonly left: { value: ReadonlySet<number> };
}) {
  const toggle = (id: number) => () => {
    const next = new Set(left.value);
    if (!next.delete(id)) next.add(id);
    left.value = next;
  };
  const none = left.value.size === detail.channels.length;
  return (
    <details class="channels">
      <summary>
        {TEXT.channels}{" "}
        <span class="unit">{TEXT.chosenOfAll(detail.channels.length - left.value.size, detail.channels.length)}</span>
      </summary>
      <Button
        look="small"
        words={none ? COMMON.all : TEXT.none}
        onClick={() => (left.value = none ? new Set() : new Set(detail.channels.map(({ id }) => id)))}
      />
      {detail.channels.map(({ id, title, name, unit, device, group }) => (
        <label key={id}>
          <input type="checkbox" checked={!left.value.has(id)} onChange={toggle(id)} />
          {title || name}
          <span class="unit">
            {[
              unit,
              group,
              detail.devices.length > 1 ? (detail.devices.find((one) => one.id === device)?.name ?? device) : "",
            ]
              .filter(Boolean)
              .join(" · ")}
          </span>
        </label>
      ))}
    </details>
  );
}

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
function devicesFor(info: Pick<RecordingInfo, "devices">, format: ExportCapability): RecordingInfo["devices"] {
  return info.devices.filter(({ protocol }) => format.protocol === "" || protocol === format.protocol);
}

/** The size of an export, and whether that was measured on this recording. */
interface Size {
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
