/** The packet view: the frame that made a sample, byte by byte, with its neighbours and a way back to the plot. */
import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { spaced } from "../forms/frame-chips";
import type { PacketAt, ShownSample, App } from "../page/context";
import { Button } from "../ui/controls/button";
import { copyText } from "../ui/dom/copy";
import { Dialog } from "../ui/controls/dialog";
import { clock, number } from "../ui/format/format";
import { IconButton } from "../ui/controls/icon-button";
import { ProblemNote } from "../requests/problem-note";
import { useAnswer } from "../requests/use-answer";
import type { PacketInfo } from "../wire/routes";
import { fetchFrames, type FramesAsk, packetTitle } from "./packet-frames";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/packets";
import "./packet.css";

/** Neighbours on each side. */
const FRAMES_BESIDE = 12;

interface Props {
  readonly at: PacketAt;
  /** Name of the device. */
  readonly name: string;
  readonly onClose: () => void;
}

type Ask = Omit<FramesAsk, "beside">;

/** The dialog of a page. */
export function OpenPacket({ app, onClose }: { readonly app: App; readonly onClose: () => void }) {
  const at = app.packetAt.value;
  if (!at) return null;
  const name = app.store.devices.value.find(({ id }) => id === at.device)?.name ?? at.device;
  return <PacketDialog key={`${at.device} ${at.time}`} at={at} name={at.name ?? name} onClose={onClose} />;
}

export function PacketDialog({ at, name, onClose }: Props) {
  const { time, base, channel, kind, rank } = at;
  const ask = useSignal<Ask>({
    time,
    base,
    ...(channel === undefined ? {} : { channel }),
    ...(rank === undefined ? {} : { rank }),
    ...(kind ? { kind } : {}),
  });
  const place = useSignal(0);
  /** Device time of the sample less its arrival, s: a frame nearby is shown in the plot with the same. */
  const ahead = useSignal(0);
  const asked = ask.value;
  const found = useAnswer(JSON.stringify(asked), async (over) => {
    const outcome = await fetchFrames(at, { ...asked, beside: FRAMES_BESIDE });
    if (over.aborted || !outcome.ok) return outcome;
    place.value = outcome.value.at;
    const first = outcome.value.packets[outcome.value.at];
    if (first && outcome.value.time !== null && base === "device") ahead.value = outcome.value.time - first.arrival;
    return outcome;
  });
  const view = found.answer;
  const packets = view?.packets ?? [];
  const packet = packets[place.value];
  const select = (n: number): void => {
    const next = packets[n];
    if (!next) return;
    place.value = n;
    // at the end of the list: its neighbours too
    if (n === 0 || n === packets.length - 1) ask.value = { time: next.arrival, base: "arrival", rank: next.rank };
  };
  const moved = useRef(select);
  moved.current = select;
  useEffect(() => {
    // of the whole page: the focus begins on the heading of the dialog
    const onKey = (event: KeyboardEvent): void => {
      const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
      if (step === undefined) return;
      event.preventDefault();
      moved.current(place.peek() + step);
    };
    addEventListener("keydown", onKey);
    return () => removeEventListener("keydown", onKey);
  }, [place]);
  return (
    <Dialog title={TEXT.packetOf(name)} wide onClose={onClose}>
      <div class="packet" role="group" aria-label={TEXT.packet}>
        <ol class="packet-neighbours text-sm" aria-label={TEXT.neighbours}>
          {packets.map((one, n) => (
            <li key={`${one.arrival} ${one.rank}`}>
              <button type="button" aria-current={n === place.value} onClick={() => select(n)}>
                <span class="ellipsis">
                  {one.kind === "reject" && <span class="dot bad" />} {packetTitle(one)}
                </span>
                <span class="num dim">{one.gap_ms === null ? "" : TEXT.gap(number(one.gap_ms, 2))}</span>
              </button>
            </li>
          ))}
        </ol>
        <div class="packet-frame flex-column">
          {found.problem && <ProblemNote problem={found.problem} />}
          {!packet && !found.problem && <p role="status">{TEXT.loading}</p>}
          {packet && (
            <Frame
              packet={packet}
              time={asked.channel !== undefined && place.value === view?.at ? view.time : null}
              sample={asked.channel !== undefined && place.value === view?.at ? at.sample : undefined}
              step={(by) => select(place.value + by)}
              show={() => {
                at.pin(packet.arrival + ahead.value);
                onClose();
              }}
            />
          )}
        </div>
      </div>
    </Dialog>
  );
}

interface FrameProps {
  readonly packet: PacketInfo;
  /** Of the sample that was asked for, unix s. */
  readonly time: number | null;
  /** That sample as its plot shows it. */
  readonly sample: ShownSample | undefined;
  readonly step: (by: number) => void;
  readonly show: () => void;
}

function Frame({ packet, time, sample, step, show }: FrameProps) {
  const said = useSignal(TEXT.copyHex);
  /** The sample whose part was brought into sight. */
  const marked = useRef<ShownSample | undefined>(undefined);
  const copyHex = async (): Promise<void> => {
    said.value = (await copyText(spaced(packet.hex))) ? COMMON.copied : COMMON.notCopied;
    setTimeout(() => (said.value = TEXT.copyHex), 2000);
  };
  const moment = clock(packet.arrival, 6);
  const facts = [
    packet.kind === "sent" ? TEXT.sentAt(moment) : TEXT.arrivedAt(moment),
    time === null ? "" : TEXT.sampledAt(clock(time, 6)),
    packet.gap_ms === null ? "" : TEXT.after(number(packet.gap_ms, 3)),
    TEXT.size(packet.size),
  ];
  const rest = packet.size - packet.hex.length / 2;
  return (
    <>
      <div class="control-row">
        <IconButton icon="left" label={TEXT.previous} class="edge" onClick={() => step(-1)} />
        <IconButton icon="right" label={TEXT.next} class="edge" onClick={() => step(1)} />
        <h3>{packetTitle(packet)}</h3>
        <span class="grow" />
        <Button look="edge" words={said.value} onClick={() => void copyHex()} />
        <Button look="edge" words={TEXT.showInPlot} onClick={show} />
      </div>
      <p class="dim">{facts.filter(Boolean).join(" · ")}</p>
      {sample && (
        <p class="packet-sample">
          {TEXT.shownAs} <b>{sample.name}</b> <span class="num">{sample.value}</span>
        </p>
      )}
      <p>
        {packet.kind === "reject" && <span class="dot bad" />} {packet.verdict}{" "}
        <span class="dim">
          {packet.doc} {packet.source !== "" && TEXT.section(packet.source)}
        </span>
      </p>
      <div class="packet-bytes" tabIndex={0} role="region" aria-label={TEXT.bytes}>
        <table>
          <thead>
            <tr>
              <th scope="col">{TEXT.offset}</th>
              <th scope="col">{TEXT.bytes}</th>
              <th scope="col">{TEXT.meaning}</th>
              <th scope="col">{TEXT.raw}</th>
            </tr>
          </thead>
          <tbody>
            {packetRows(packet, sample).map((row) => (
              <tr
                key={row.offset}
                ref={(tr) => {
                  if (tr && row.isSample && marked.current !== sample) tr.scrollIntoView?.({ block: "nearest" });
                  if (tr && row.isSample) marked.current = sample;
                }}
                class={row.isSample ? "asked" : row.isField ? "" : "envelope"}
                aria-current={row.isSample}
              >
                <td class="num dim">{row.offset}</td>
                <td class="mono">{row.bytes}</td>
                <td>{row.words}</td>
                <td class="dim">{row.raw}</td>
              </tr>
            ))}
          </tbody>
        </table>
        {rest > 0 && <p class="dim">{TEXT.moreBytes(rest)}</p>}
      </div>
    </>
  );
}

interface PacketRow {
  readonly offset: number;
  readonly bytes: string;
  readonly words: string;
  /** Value on the wire; "" for the envelope, and where it is what the words say. */
  readonly raw: string;
  readonly isField: boolean;
  /** The sample that was asked for is here. */
  readonly isSample: boolean;
}

/** A longer run of bytes is cut here; the copy has them all. */
const MAX_BYTES = 32;

/** @param sample whose part is marked */
export function packetRows(
  { hex, spans, fields }: Pick<PacketInfo, "hex" | "spans" | "fields">,
  sample?: ShownSample,
): readonly PacketRow[] {
  const parts = spans.length > 0 ? spans : [{ offset: 0, size: hex.length / 2, label: "", path: "" }];
  return parts.map(({ offset, size, label, path }) => ({
    offset,
    bytes: spaced(hex.slice(2 * offset, 2 * (offset + size)), MAX_BYTES),
    words: label,
    raw: path === "" ? "" : rawText(fieldValue(fields, path)),
    isField: path !== "",
    isSample: sample !== undefined && isPartOf(path, sample),
  }));
}

/** Whether the part at a path has a sample: its column, or all of its channel where the frame has that in one part or it was computed. */
function isPartOf(path: string, { message, channel, column, at }: ShownSample): boolean {
  const name =
    channel === message ? column : channel.startsWith(`${message}.`) ? channel.slice(message.length + 1) : channel;
  if (path === name || path === `${name}.${at}`) return true;
  return at < 0 && path.startsWith(`${name}.`);
}

/** The value at a path: "acc.0", "outputs.3.rate". Names of fields may contain dots, so the longest that fits is taken. */
export function fieldValue(fields: unknown, path: string): unknown {
  if (path === "" || typeof fields !== "object" || fields === null) return path === "" ? fields : undefined;
  const words = path.split(".");
  for (let n = words.length; n > 0; n--) {
    const name = words.slice(0, n).join(".");
    if (Object.hasOwn(fields, name)) {
      const found = fieldValue((fields as Record<string, unknown>)[name], words.slice(n).join("."));
      if (found !== undefined) return found;
    }
  }
  return undefined;
}

/** Digits that tell two 32-bit numbers apart. */
const DIGITS = 9;

function rawText(value: unknown): string {
  if (typeof value === "number") return Number.isInteger(value) ? `${value}` : `${Number(value.toPrecision(DIGITS))}`;
  if (typeof value === "string" || typeof value === "boolean") return `${value}`;
  if (Array.isArray(value)) return value.map(rawText).join(", ");
  return "";
}
