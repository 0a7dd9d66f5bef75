/** Export: which part, in which form, of which channels; how long and how large it will be is said before anything is written. */
import { signal, useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { bytes, length, titleOf } from "../../recordings/library-filter";
import { devicesFor, type FormatInfo, formatsOf, sizeOf } from "../../recordings/export-formats";
import { server } from "../../recordings/api";
import type { ExportSizes, RecordingDetail, RecordingInfo } from "../../recordings/types";
import { Dialog } from "../../ui/dialog";
import { count, span } from "../../ui/format";
import { Icon } from "../../ui/icons";
import { Message } from "../../ui/message";
import type { ExportJob } from "../../wire/types";
import { type App, run } from "../app-state";

export interface Range {
  readonly name: string;
  readonly t0: number;
  readonly t1: number;
}

/** What the dialog is about: the recording, and where it is open, its channels and the ranges that are chosen there. */
export interface Exporting {
  readonly info: RecordingInfo;
  readonly detail: RecordingDetail | undefined;
  readonly ranges: readonly Range[];
  /** Where the recording begins, unix s. */
  readonly first: number;
  readonly base: "device" | "arrival";
}
export const exporting = signal<Exporting | undefined>(undefined);

export function ExportDialog({ app, of }: { readonly app: App; readonly of: Exporting }) {
  const { info, detail, ranges, first, base } = of;
  const formats = formatsOf(info);
  const format = useSignal<FormatInfo | undefined>(formats[0]);
  const range = useSignal<Range | undefined>(undefined);
  const left = useSignal<ReadonlySet<number>>(new Set());
  const device = useSignal("");
  const busy = useSignal(false);
  const chosen = format.value;
  if (!chosen) return null;
  const devices = devicesFor(info, chosen);
  const only = chosen.single ? devices.find(({ id }) => id === device.value) ?? devices[0] : undefined;
  const channels = chosen.single || left.value.size === 0 ? undefined : (detail?.channels.map(({ id }) => id).filter((id) => !left.value.has(id)) ?? undefined);
  const seconds = range.value ? range.value.t1 - range.value.t0 : (info.duration ?? 0);
  const measured = useMeasured(of, range.value, chosen.single ? undefined : channels);
  const size = (one: FormatInfo): string => {
    const device = devicesFor(info, one).find(({ id }) => id === only?.id) ?? devicesFor(info, one)[0];
    const { bytes: found, measured: isMeasured } = sizeOf(one, info, seconds, device?.id, measured);
    const { value, unit } = bytes(found);
    return `${isMeasured ? "about" : "roughly"} ${value} ${unit}`;
  };
  const go = async (): Promise<void> => {
    busy.value = true;
    const job = await run(server.export(info.id, { format: chosen.name, t0: range.value?.t0 ?? null, t1: range.value?.t1 ?? null, channels: channels ?? null, device: only?.id ?? "", base }));
    const { exports } = app.store;
    if (job && !exports.peek().some(({ id }) => id === job.id)) exports.value = [...exports.peek(), job];
    busy.value = false;
  };
  const n = channels?.length ?? detail?.channels.length;
  return (
    <Dialog title={`Export ${titleOf(info)}`} onClose={() => (exporting.value = undefined)}>
      <div class="export">
        {ranges.length > 0 && (
          <div class="seg wideseg" role="group" aria-label="Which part">
            <button type="button" aria-pressed={range.value === undefined} onClick={() => (range.value = undefined)}>
              Whole
            </button>
            {ranges.map((one) => (
              <button type="button" key={one.name} aria-pressed={range.value?.name === one.name} onClick={() => (range.value = one)}>
                {one.name}
              </button>
            ))}
          </div>
        )}
        <p class="dim">
          {range.value ? `${length(range.value.t0 - first, 1)} to ${length(range.value.t1 - first, 1)}, ` : "From the beginning to the end, "}
          {lengthWords(seconds)}
          {n !== undefined && !chosen.single ? `, ${count(n, "channel")}` : ""}, by {base === "device" ? "device" : "arrival"} time
        </p>
        <div class="formats" role="radiogroup" aria-label="Format">
          {formats.map((one) => (
            <label key={one.name} class={one === chosen ? "on" : ""}>
              <input type="radio" name="format" checked={one === chosen} onChange={() => (format.value = one)} />
              <b>{one.title}</b>
              <small>{one.words}</small>
              <span class="num">
                {size(one)}
              </span>
            </label>
          ))}
        </div>
        {chosen.single && devices.length > 1 && (
          <label class="select">
            <span>Device</span>
            <select value={only?.id ?? ""} onChange={(event) => (device.value = event.currentTarget.value)}>
              {devices.map((one) => (
                <option key={one.id} value={one.id}>
                  {one.product || one.name} {one.serial_number}
                </option>
              ))}
            </select>
            <Icon name="down" />
          </label>
        )}
        {!chosen.single && detail && <Channels detail={detail} left={left} />}
        <button type="button" class="btn main go" disabled={busy.value || channels?.length === 0} onClick={() => void go()}>
          <Icon name="download" />
          Export {chosen.title}, {size(chosen)}
        </button>
        <Jobs app={app} recording={info.id} />
      </div>
    </Dialog>
  );
}

/** A person who chooses channels is not asked after each of them. */
const MEASURE_AFTER_MS = 300;

/** What the server measured of that stretch and those channels; undefined until it has. One that would have to be decoded first is not. */
function useMeasured({ info, detail, base }: Exporting, range: Range | undefined, channels: readonly number[] | undefined): ExportSizes | undefined {
  const found = useSignal<{ readonly key: string; readonly sizes: ExportSizes } | undefined>(undefined);
  const wish = { t0: range?.t0 ?? null, t1: range?.t1 ?? null, channels: channels ?? null, base };
  const key = JSON.stringify(wish);
  useEffect(() => {
    if ((!info.opened && detail === undefined) || channels?.length === 0) return;
    let over = false;
    const timer = setTimeout(() => {
      void server.exportSizes(info.id, wish).then((answer) => {
        if (!over && answer.ok) found.value = { key, sizes: answer.value };
      });
    }, found.peek() === undefined ? 0 : MEASURE_AFTER_MS);
    return () => {
      over = true;
      clearTimeout(timer);
    };
  }, [info.id, info.opened, key]);
  return found.value?.key === key ? found.value.sizes : undefined;
}

function lengthWords(seconds: number): string {
  const { value, unit } = span(seconds);
  return seconds < 60 ? `${value} ${unit}` : `${length(seconds)} ${seconds < 3600 ? "min" : "h"}`;
}

function Channels({ detail, left }: { readonly detail: RecordingDetail; readonly left: { value: ReadonlySet<number> } }) {
  const toggle = (id: number) => () => {
    const next = new Set(left.value);
    if (!next.delete(id)) next.add(id);
    left.value = next;
  };
  const none = left.value.size === detail.channels.length;
  return (
    <details class="chans">
      <summary>
        Channels <span class="u">{detail.channels.length - left.value.size} of {detail.channels.length}</span>
      </summary>
      <button type="button" class="btn small" onClick={() => (left.value = none ? new Set() : new Set(detail.channels.map(({ id }) => id)))}>
        {none ? "All" : "None"}
      </button>
      {detail.channels.map(({ id, title, name, unit, device, group }) => (
        <label key={id}>
          <input type="checkbox" checked={!left.value.has(id)} onChange={toggle(id)} />
          {title || name}
          <span class="u">{[unit, group, detail.devices.length > 1 ? (detail.devices.find((one) => one.id === device)?.name ?? device) : ""].filter(Boolean).join(" · ")}</span>
        </label>
      ))}
    </details>
  );
}

/** Exports of a recording: under way, done, failed. */
export function Jobs({ app, recording }: { readonly app: App; readonly recording: string }) {
  const jobs = app.store.exports.value.filter((job) => job.recording === recording);
  if (jobs.length === 0) return null;
  return (
    <ul class="jobs" aria-label="Exports">
      {[...jobs].reverse().map((job) => (
        <JobRow key={job.id} job={job} />
      ))}
    </ul>
  );
}

function JobRow({ job }: { readonly job: ExportJob }) {
  const size = bytes(job.size);
  const going = job.state === "waiting" || job.state === "running";
  const words = { waiting: "waits", running: `${Math.round(100 * job.progress)} %`, done: `${size.value} ${size.unit}`, failed: "failed", cancelled: "cancelled" }[job.state];
  return (
    <li>
      <span class="ell">{job.title}</span>
      <span class="num" role="status">
        {job.state === "failed" && <span class="dot bad" />} {words}
      </span>
      {job.state === "done" ? (
        <a class="btn edge" href={server.exportUrl(job.id)} download={job.file}>
          <Icon name="download" />
          Download
        </a>
      ) : (
        <button type="button" class="btn edge" onClick={() => void run(server.cancelExport(job.id))}>
          {going ? "Cancel" : "Forget"}
        </button>
      )}
      {going && <progress value={job.progress} max={1} aria-label={`${job.title}: ${words}`} />}
      {job.message !== "" && (
        <small class="why">
          <Message text={job.message} /> <Message text={job.hint} />
        </small>
      )}
    </li>
  );
}
