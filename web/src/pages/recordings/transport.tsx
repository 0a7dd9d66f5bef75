/** Playback controls of a recording: play, step, speed, loop, marker. */
import { length } from "../../recordings/library-filter";
import { SPEEDS } from "../../recordings/playback";
import type { ReplayController } from "../../recordings/replay-controller";
import { Select } from "../../ui/choices";
import { LiveText, type Panel } from "../../ui/dom";
import { number } from "../../ui/format";
import { Icon, type IconName } from "../../ui/icons";
import { ZOOM_STEP } from "../../ui/keys";
import { PanelHost } from "../../ui/panel-host";
import type { OpenRecording } from "./open-recording";
import { zoomAtHead } from "./keys";
import { beginMarker, MarkerField } from "./markers";
import { COMMON } from "../../texts/common";
import { TEXT } from "../../texts/recordings";

export function Transport({ recording }: { readonly recording: OpenRecording }) {
  const { replay, app, said } = recording;
  const { timeBase, actions } = replay.viewState;
  const playing = replay.playing.value;
  const { first } = replay.bounds;
  const loop = replay.looping.value ? replay.loop.value : undefined;
  const step = (samples: number): void => {
    replay.playing.value = false;
    actions.stepSample(samples);
  };
  return (
    <div class="transport" role="region" aria-label={TEXT.playback}>
      <Button icon="first" label={TEXT.toStart} class="desk" act={() => replay.seek(first)} />
      <Button icon="stepBack" label={COMMON.backOneSample} act={() => step(-1)} />
      <button
        type="button"
        class="btn main icon play"
        aria-label={playing ? COMMON.pause : TEXT.play}
        title={TEXT.withSpaceKey(playing ? COMMON.pause : TEXT.play)}
        onClick={() => replay.toggle()}
      >
        <Icon name={playing ? "pause" : "play"} />
      </button>
      <Button icon="stepForward" label={COMMON.forwardOneSample} act={() => step(1)} />
      <PanelHost class="now" role="group" label={TEXT.playhead} mount={(host) => mountClock(host, replay)} />
      <button
        type="button"
        class={`btn loop ${loop ? "on" : ""}`}
        aria-pressed={loop !== undefined}
        aria-label={TEXT.loopView}
        title={TEXT.loopViewHint}
        onClick={() => replay.toggleLoop()}
      >
        <Icon name="loop" />
        <span class="desk">
          {loop ? TEXT.rangeOfLoop(length(loop[0] - first, 1), length(loop[1] - first, 1)) : TEXT.loop}
        </span>
      </button>
      <button
        type="button"
        class="btn"
        aria-label={COMMON.marker}
        title={TEXT.addMarkerHereHint}
        onClick={() => beginMarker(recording)}
      >
        <Icon name="flag" />
        <span class="wide">{COMMON.marker}</span>
      </button>
      <button
        type="button"
        class="btn desk follow"
        aria-pressed={replay.follow.value}
        title={TEXT.followHint}
        onClick={() => (replay.follow.value = !replay.follow.value)}
      >
        {TEXT.follow}
      </button>
      <span class="grow" />
      <span role="status" class={said.value ? "tag yours" : "visually-hidden"}>
        {said.value}
      </span>
      <Button
        icon="minus"
        label={COMMON.zoomOut(number(ZOOM_STEP, 1))}
        class="desk wide"
        act={() => zoomAtHead(replay, ZOOM_STEP)}
      />
      <Button
        icon="plus"
        label={COMMON.zoomIn(number(ZOOM_STEP, 1))}
        class="desk wide"
        act={() => zoomAtHead(replay, 1 / ZOOM_STEP)}
      />
      <Button icon="fit" label={TEXT.fitAll} class="desk" act={() => actions.fit()} />
      <Select
        title={TEXT.speedHint}
        class="speed"
        label={TEXT.speed}
        value={replay.speed.value}
        options={SPEEDS.map((speed) => [speed, `${speed}×`])}
        onChoose={(speed) => (replay.speed.value = speed)}
      />
      <button
        type="button"
        class="btn desk"
        aria-label={TEXT.timeAxisOf(timeBase.value)}
        title={TEXT.deviceTimeOrArrivalTimeT}
        onClick={() => actions.toggleTimeBase()}
      >
        {timeBase.value === "device" ? COMMON.deviceTime : COMMON.arrivalTime}
      </button>
      <button
        type="button"
        class="btn edge only-narrow phone-shown"
        aria-label={TEXT.moreActions}
        title={TEXT.moreActions}
        onClick={() => (app.sheet.value = "rail")}
      >
        <Icon name="share" />
      </button>
      <MarkerField recording={recording} />
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

/** Position and length; written by the frame loop. */
function mountClock(host: HTMLElement, replay: ReplayController): Panel {
  const now = new LiveText();
  const whole = document.createElement("small");
  whole.textContent = ` / ${length(replay.bounds.last - replay.bounds.first)}`;
  host.append(now.node, whole);
  return { update: () => now.set(length(replay.head - replay.bounds.first, 3)), dispose: () => host.replaceChildren() };
}
