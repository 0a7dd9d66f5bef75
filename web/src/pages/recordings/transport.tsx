/** The controls of a recording's time: play, step, speed, loop, marker. */
import * as actions from "../../data/view-actions";
import { view } from "../../data/view-state";
import { length } from "../../recordings/library-filter";
import { SPEEDS } from "../../recordings/playback";
import type { Replay } from "../../recordings/replay-controller";
import { Live, type Panel } from "../../ui/dom";
import { number } from "../../ui/format";
import { Icon, type IconName } from "../../ui/icons";
import { ZOOM_STEP } from "../../ui/keys";
import { Mounted } from "../../ui/panel-host";
import { sheet } from "../app-state";
import { said } from "./share-menu";
import { zoomAtHead } from "./keys";
import { beginMarker, MarkerField } from "./markers";

export function Transport({ replay }: { readonly replay: Replay }) {
  const playing = replay.playing.value;
  const { first } = replay.bounds;
  const loop = replay.looping.value ? replay.loop.value : undefined;
  const step = (samples: number): void => {
    replay.playing.value = false;
    actions.stepSample(samples);
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
      <span role="status" class={said.value ? "tag yours" : "vh"}>
        {said.value}
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
      <button type="button" class="btn edge only-narrow phoneshown" aria-label="Export, link, markers, devices" title="Export, link, markers, devices" onClick={() => (sheet.value = "rail")}>
        <Icon name="share" />
      </button>
      <MarkerField replay={replay} />
    </div>
  );
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
