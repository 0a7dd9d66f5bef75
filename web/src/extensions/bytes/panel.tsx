/**
 * The newest frames of the selected device, with their gaps and first bytes: as they arrive, up to the cursor where one is set, and up to
 * the reading position over a recording. It follows or holds; a frame opens the packet view.
 */
import { type Signal, signal } from "@preact/signals";
import { render } from "preact";
import { spaced } from "../../forms/frame-chips";
import { ageOf, reading, selected } from "../../panels/panel-context";
import type { Deps } from "../../page/context";
import { Button } from "../../ui/controls/button";
import { type Panel, throttle } from "../../ui/dom/dom";
import { clock, number } from "../../ui/format/format";
import { LatestAnswer } from "../../requests/latest-answer";
import { Answered } from "../../requests/use-answer";
import type { PacketInfo } from "../../wire/routes";
import { fetchFrames, packetTitle } from "../../pages/packet-frames";
import { TEXT as PACKETS } from "../../texts/packets";
import { TEXT } from "./texts";
import "./bytes.css";

/** Frames shown. */
const MAX_FRAMES = 24;
/** Lists a second while frames arrive: more cannot be read. */
const PER_SECOND = 2;
/** First bytes of a frame in its row. */
const MAX_BYTES = 24;

/** Newest first. */
type Frames = readonly PacketInfo[];

class Bytes {
  readonly #deps: Deps;
  readonly #host: HTMLElement;
  readonly #latest = new LatestAnswer<Frames>();
  /** Of the frames that are to be shown: their device, and their time but for the newest. */
  readonly #question = signal("");
  readonly #isHeld = signal(false);
  readonly #due = throttle(PER_SECOND);
  #device: string | undefined;
  #asked = "";
  #isAsking = false;
  #isGone = false;

  constructor(host: HTMLElement, deps: Deps) {
    [this.#deps, this.#host] = [deps, host];
    const open = (packet: PacketInfo): void => this.#open(packet);
    render(<View latest={this.#latest} question={this.#question} isHeld={this.#isHeld} open={open} />, host);
  }

  update(now: number): void {
    if (!this.#due(now)) return;
    const device = selected(this.#deps)?.id;
    if (device !== this.#device) {
      [this.#device, this.#asked] = [device, ""];
      this.#isHeld.value = false;
    }
    if (device === undefined || this.#isHeld.peek() || this.#isAsking || document.visibilityState === "hidden") return;
    if (this.#isPressed) return;
    const time = this.#time(device);
    if (time === undefined || `${device} ${time}` === this.#asked) return;
    this.#asked = `${device} ${time}`;
    const isNewest = reading(this.#deps).time === Number.POSITIVE_INFINITY;
    this.#question.value = `${device} ${isNewest ? "" : time}`;
    void this.#ask(device, time, this.#question.value);
  }

  /** A row that moved away under a pointer would not be clicked. */
  get #isPressed(): boolean {
    return this.#host.matches(":active");
  }

  /** The moment read: that of the last byte while live. */
  #time(device: string): number | undefined {
    const { time } = reading(this.#deps);
    const age = ageOf(this.#deps, device);
    const newest = age === undefined ? undefined : this.#deps.store.serverNow() - age;
    if (this.#deps.recording) return Number.isFinite(time) ? time : newest;
    return newest === undefined ? undefined : Math.min(time, newest);
  }

  async #ask(device: string, time: number, question: string): Promise<void> {
    this.#isAsking = true;
    const { recording } = this.#deps;
    const place = { device, ...(recording ? { recording: recording.id } : {}) };
    const outcome = await fetchFrames(place, { time, base: "arrival", beside: MAX_FRAMES });
    this.#isAsking = false;
    if (this.#isGone || device !== this.#device || this.#isHeld.peek()) return;
    if (this.#isPressed) {
      this.#asked = "";
      return;
    }
    if (!outcome.ok) return this.#latest.take(question, outcome);
    const { packets, at } = outcome.value;
    const value = packets
      .slice(0, at + 1)
      .reverse()
      .slice(0, MAX_FRAMES);
    this.#latest.take(question, { ok: true, value });
  }

  #open({ arrival, rank }: PacketInfo): void {
    const { open, recording, viewState } = this.#deps;
    if (this.#device === undefined) return;
    const pin = (at: number): void => viewState.actions.pinInView(at);
    const place = { device: this.#device, ...(recording ? { recording: recording.id } : {}) };
    open.packet({ ...place, time: arrival, base: "arrival", rank, pin });
  }

  dispose(): void {
    this.#isGone = true;
    render(null, this.#host);
  }
}

interface ViewProps {
  readonly latest: LatestAnswer<Frames>;
  readonly question: Signal<string>;
  readonly isHeld: Signal<boolean>;
  readonly open: (packet: PacketInfo) => void;
}

function View({ latest, question, isHeld, open }: ViewProps) {
  const none = (
    <p class="foot-note dim" role="status">
      {TEXT.noFrames}
    </p>
  );
  return (
    <>
      <div class="bytes-tools control-row text-sm">
        <Button
          look="small edge"
          words={isHeld.value ? TEXT.follow : TEXT.hold}
          aria-pressed={isHeld.value}
          title={TEXT.holdHint}
          onClick={() => (isHeld.value = !isHeld.value)}
        />
        <span class="dim">{isHeld.value ? TEXT.isHeld : TEXT.newestFirst}</span>
      </div>
      <Answered of={latest.of(question.value)} waiting={none}>
        {(frames) =>
          frames.length === 0 ? (
            none
          ) : (
            <ol class="bytes-list text-sm" aria-label={TEXT.newestFrames}>
              {frames.map((packet) => (
                <li key={`${packet.arrival} ${packet.rank}`}>
                  <button type="button" title={packet.verdict} onClick={() => open(packet)}>
                    <span class="num dim">{clock(packet.arrival, 3)}</span>
                    <b class="ellipsis">
                      {packet.kind === "reject" && <span class="dot bad" />} {packetTitle(packet)}
                    </b>
                    <span class="num dim">{PACKETS.size(packet.size)}</span>
                    <span class="num dim">{packet.gap_ms === null ? "" : PACKETS.gap(number(packet.gap_ms, 2))}</span>
                    <span class="mono ellipsis">{spaced(packet.hex, MAX_BYTES)}</span>
                  </button>
                </li>
              ))}
            </ol>
          )
        }
      </Answered>
    </>
  );
}

export const mountBytes = (host: HTMLElement, deps: Deps): Panel => new Bytes(host, deps);
