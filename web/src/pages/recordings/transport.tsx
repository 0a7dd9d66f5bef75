/** Playback controls of a recording: play, step, speed, loop, marker. */
import { length } from "../../recordings/library-filter";
import { SPEEDS } from "../../recordings/playback";
import type { ReplayController } from "../../recordings/replay-controller";
import { Button } from "../../ui/controls/button";
import { Select } from "../../ui/controls/choices";
import { LiveText, type Panel } from "../../ui/dom/dom";
import { number } from "../../ui/format/format";
import { IconButton } from "../../ui/controls/icon-button";
import { ZOOM_STEP } from "../../page/keys";
import { PanelHost } from "../../panels/panel-host";
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
    <div class="transport flex-row" role="region" aria-label={TEXT.playback}>
      <IconButton icon="first" label={TEXT.toStart} class="desk" onClick={() => replay.seek(first)} />
      <IconButton icon="stepBack" label={COMMON.backOneSample} onClick={() => step(-1)} />
      <IconButton
        class="main play"
        icon={playing ? "pause" : "play"}
        label={playing ? COMMON.pause : TEXT.play}
        title={TEXT.withSpaceKey(playing ? COMMON.pause : TEXT.play)}
        onClick={() => replay.toggle()}
      />
      <IconButton icon="stepForward" label={COMMON.forwardOneSample} onClick={() => step(1)} />
      <PanelHost class="now" role="group" label={TEXT.playhead} mount={(host) => mountClock(host, replay)} />
      <Button
        look={`loop ${loop ? "on" : ""}`}
        icon="loop"
        aria-pressed={loop !== undefined}
        aria-label={TEXT.loopView}
        title={TEXT.loopViewHint}
        onClick={() => replay.toggleLoop()}
      >
        <span class="desk">
          {loop ? TEXT.rangeOfLoop(length(loop[0] - first, 1), length(loop[1] - first, 1)) : TEXT.loop}
        </span>
      </Button>
      <Button
        changes
        icon="flag"
        aria-label={COMMON.marker}
        title={TEXT.addMarkerHereHint}
        onClick={() => beginMarker(recording)}
      >
        <span class="wide">{COMMON.marker}</span>
      </Button>
      <Button
        look="desk follow"
        words={TEXT.follow}
        aria-pressed={replay.follow.value}
        title={TEXT.followHint}
        onClick={() => (replay.follow.value = !replay.follow.value)}
      />
      <span class="grow" />
      <span role="status" class={said.value ? "tag yours" : "visually-hidden"}>
        {said.value}
      </span>
      <IconButton
        icon="minus"
        label={COMMON.zoomOut(number(ZOOM_STEP, 1))}
        class="desk wide"
        onClick={() => zoomAtHead(replay, ZOOM_STEP)}
      />
      <IconButton
        icon="plus"
        label={COMMON.zoomIn(number(ZOOM_STEP, 1))}
        class="desk wide"
        onClick={() => zoomAtHead(replay, 1 / ZOOM_STEP)}
      />
      <IconButton icon="fit" label={TEXT.fitAll} class="desk" onClick={() => actions.fit()} />
      <Select
        title={TEXT.speedHint}
        class="speed"
        label={TEXT.speed}
        value={replay.speed.value}
        options={SPEEDS.map((speed) => [speed, `${speed}×`])}
        onChoose={(speed) => (replay.speed.value = speed)}
      />
      <Button
        look="desk"
        words={timeBase.value === "device" ? COMMON.deviceTime : COMMON.arrivalTime}
        aria-label={TEXT.timeAxisOf(timeBase.value)}
        title={TEXT.deviceTimeOrArrivalTimeT}
        onClick={() => actions.toggleTimeBase()}
      />
      <Button
        look="edge only-narrow phone-shown"
        icon="share"
        aria-label={TEXT.moreActions}
        title={TEXT.moreActions}
        onClick={() => (app.sheet.value = "rail")}
      />
      <MarkerField recording={recording} />
    </div>
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
