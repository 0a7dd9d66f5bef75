/** The controls of a recording's time: play, step, speed, loop, marker; and handing on: export, download, link. */
import { signal } from "@preact/signals";
import * as actions from "../../data/actions";
import { view } from "../../data/view";
import { placeHref } from "../../recordings/address";
import { length } from "../../recordings/listing";
import { SPEEDS } from "../../recordings/player";
import type { Replay } from "../../recordings/replay";
import { server } from "../../recordings/server";
import { Live, type Panel } from "../../ui/dom";
import { number } from "../../ui/format";
import { Icon, type IconName } from "../../ui/icons";
import { ZOOM_STEP } from "../../ui/keys";
import { Mounted } from "../../ui/mounted";
import { type App, run, select, sheet } from "../app";
import { go } from "../route";
import { exporting, type Range } from "./export";
import { zoomAtHead } from "./keys";
import { beginMarker, MarkerField } from "./markers";

/** What was done last with the link, in words. */
const copied = signal("");
const SAID_MS = 2500;

export async function copyLink(replay: Replay): Promise<void> {
  const link = new URL(placeHref(replay.detail.info.id, replay.place()), location.href).href;
  copied.value = (await copy(link)) ? "Link copied" : "The browser does not let the page copy: the address above is the link";
  history.replaceState(null, "", placeHref(replay.detail.info.id, replay.place()));
  setTimeout(() => (copied.value = ""), SAID_MS);
}

/** Over plain HTTP to another host a browser has no clipboard for pages, but it copies a selection. */
async function copy(text: string): Promise<boolean> {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    const field = document.createElement("textarea");
    field.value = text;
    document.body.append(field);
    field.select();
    const done = document.execCommand("copy");
    field.remove();
    return done;
  }
}

/** What is chosen of a recording, to be exported. */
function rangesOf(replay: Replay): readonly Range[] {
  const { first, last } = replay.bounds;
  const { end, span } = view.peek();
  const loop = replay.looping.peek() ? replay.loop.peek() : undefined;
  const seen: Range = { name: "In view", t0: Math.max(first, end - span), t1: Math.min(last, end) };
  return [...(loop ? [{ name: "Loop range", t0: loop[0], t1: loop[1] }] : []), ...(seen.t1 > seen.t0 ? [seen] : [])];
}

export function Transport({ replay, app }: { readonly replay: Replay; readonly app: App }) {
  const { info } = replay.detail;
  const playing = replay.playing.value;
  const { first } = replay.bounds;
  const loop = replay.looping.value ? replay.loop.value : undefined;
  const step = (samples: number): void => {
    replay.playing.value = false;
    actions.stepSample(samples);
  };
  const asDevice = async (): Promise<void> => {
    const devices = await run(server.play(info.id, { speed: replay.speed.peek(), loop: replay.looping.peek(), t0: loop?.[0] ?? null, t1: loop?.[1] ?? null }));
    const [device] = devices ?? [];
    if (!device) return;
    select(device.id);
    go("live");
  };
  return (
    <div class="transport" role="region" aria-label="Playing">
      <Button icon="first" label="To the start (Home)" class="desk" act={() => replay.seek(first)} />
      <Button icon="stepBack" label="One sample back (,)" act={() => step(-1)} />
      <button type="button" class="btn main icon play" aria-label={playing ? "Pause" : "Play"} title={`${playing ? "Pause" : "Play"} (Space)`} onClick={() => replay.toggle()}>
        <Icon name={playing ? "pause" : "play"} />
      </button>
      <Button icon="stepForward" label="One sample on (.)" act={() => step(1)} />
      <Mounted class="now" role="group" label="Where it is read" mount={(host) => mountClock(host, replay)} />
      <button type="button" class={`btn loop ${loop ? "on" : ""}`} aria-pressed={loop !== undefined} aria-label="Loop what is on screen" title="Loop what is on screen (L); Shift and drag on the strip chooses a range" onClick={() => replay.toggleLoop()}>
        <Icon name="loop" />
        <span class="desk">{loop ? `${length(loop[0] - first, 1)} to ${length(loop[1] - first, 1)}` : "Loop"}</span>
      </button>
      <button type="button" class="btn" aria-label="Marker" title="Put a marker here (M)" onClick={() => beginMarker(replay)}>
        <Icon name="flag" />
        <span class="wide">Marker</span>
      </button>
      <button type="button" class="btn desk follow" aria-pressed={replay.follow.value} title="The window follows while it plays" onClick={() => (replay.follow.value = !replay.follow.value)}>
        Follow
      </button>
      <span class="grow" />
      <span role="status" class={copied.value ? "tag yours" : "vh"}>
        {copied.value}
      </span>
      <Button icon="minus" label={`Zoom out ${number(ZOOM_STEP, 1)} times (−)`} class="desk wide" act={() => zoomAtHead(replay, ZOOM_STEP)} />
      <Button icon="plus" label={`Zoom in ${number(ZOOM_STEP, 1)} times (+)`} class="desk wide" act={() => zoomAtHead(replay, 1 / ZOOM_STEP)} />
      <Button icon="fit" label="All of it (F)" class="desk" act={() => actions.fit()} />
      <label class="select speed" title="How fast it plays">
        <select aria-label="Speed" value={String(replay.speed.value)} onChange={(event) => (replay.speed.value = Number(event.currentTarget.value))}>
          {SPEEDS.map((speed) => (
            <option key={speed} value={String(speed)}>
              {speed}×
            </option>
          ))}
        </select>
        <Icon name="down" />
      </label>
      <button type="button" class="btn desk" aria-label={`Time axis: ${view.value.timeBase} time`} title="Device time or arrival time (T)" onClick={() => actions.toggleTimeBase()}>
        {view.value.timeBase === "device" ? "Device time" : "Arrival time"}
      </button>
      <details class="menu" onToggle={(event) => event.currentTarget.open && closeOutside(event.currentTarget)}>
        <summary class="btn edge" aria-label="Hand on" title="Export, download, link, play as a device">
          <Icon name="share" />
          <span class="desk">Hand on</span>
        </summary>
        <div class="items">
          <button type="button" class="btn" onClick={() => (exporting.value = { info, detail: replay.detail, ranges: rangesOf(replay), base: view.peek().timeBase })}>
            <Icon name="upload" /> Export…
          </button>
          <a class="btn" href={server.downloadUrl(info.id)} download={info.file}>
            <Icon name="download" /> Download the file
          </a>
          <button type="button" class="btn" onClick={() => void asDevice()}>
            <Icon name="wave" /> Play as a live device
          </button>
          <button type="button" class="btn phone" onClick={() => (sheet.value = "rail")}>
            <Icon name="flag" /> Markers and devices
          </button>
        </div>
      </details>
      <button type="button" class="btn edge" aria-label="Copy link" title="Copy the link to what is on screen (C)" onClick={() => void copyLink(replay)}>
        <Icon name="share" />
        <span class="wide">Copy link</span>
      </button>
      <MarkerField replay={replay} />
      <span class="vh">{app.store.connection.value}</span>
    </div>
  );
}

/** A menu closes when something else is pressed, or something in it was chosen. */
function closeOutside(menu: HTMLDetailsElement): void {
  const close = (event: Event): void => {
    if (event.target instanceof Node && menu.querySelector("summary")?.contains(event.target)) return;
    menu.open = false;
    removeEventListener("click", close);
  };
  setTimeout(() => addEventListener("click", close));
}

interface ButtonProps {
  readonly icon: IconName;
  readonly label: string;
  readonly class?: string;
  readonly act: () => void;
}

function Button({ icon, label, class: name = "", act }: ButtonProps) {
  return (
    <button type="button" class={`btn icon ${name}`} aria-label={label} title={label} onClick={act}>
      <Icon name={icon} />
    </button>
  );
}

/** Where it is read, of how much; written by the frame loop. */
function mountClock(host: HTMLElement, replay: Replay): Panel {
  const now = new Live();
  const whole = document.createElement("small");
  whole.textContent = ` / ${length(replay.bounds.last - replay.bounds.first)}`;
  host.append(now.node, whole);
  return {
    update: () => now.set(length(replay.head - replay.bounds.first, 3)),
    dispose: () => host.replaceChildren(),
  };
}
