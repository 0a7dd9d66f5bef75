/** Markers and notes of a recording: a press jumps there, and more can be added. */
import { useLayoutEffect, useRef } from "preact/hooks";
import { length } from "../../recordings/library-filter";
import { recordingsApi } from "../../recordings/api";
import { Button } from "../../ui/controls/button";
import { IconButton } from "../../ui/controls/icon-button";
import { run } from "../../page/app-state";
import type { OpenRecording } from "./open-recording";
import { COMMON } from "../../texts/common";
import { TEXT } from "../../texts/recordings";

export function beginMarker({ replay, placing }: OpenRecording): void {
  placing.value = replay.head;
}

export function Markers({ recording }: { readonly recording: OpenRecording }) {
  const { replay, app } = recording;
  const markers = [...replay.markers.value].sort((a, b) => a.time - b.time);
  return (
    <section aria-label={COMMON.markers} class="markers">
      <div class="head further">
        <h3>{COMMON.markers}</h3>
        <span>{markers.length}</span>
        <span class="grow" />
        <IconButton
          changes
          icon="plus"
          label={TEXT.addMarkerHere}
          title={TEXT.addMarkerHereHint}
          onClick={() => beginMarker(recording)}
        />
      </div>
      {markers.length === 0 && <p class="foot-note dim">{TEXT.noMarkers}</p>}
      <ol>
        {markers.map(({ id, time, kind, text }) => (
          <li key={id}>
            <button
              type="button"
              onClick={() => {
                replay.seek(time);
                app.sheet.value = undefined;
              }}
            >
              <time>{length(time - replay.bounds.first, 1)}</time>
              <span>{text || (kind === "note" ? TEXT.note : TEXT.marker)}</span>
            </button>
          </li>
        ))}
      </ol>
    </section>
  );
}

/** Text of a marker, optional. Enter saves it, Esc does not. */
export function MarkerField({ recording }: { readonly recording: OpenRecording }) {
  const { replay, app, placing } = recording;
  const field = useRef<HTMLInputElement>(null);
  const time = placing.value;
  useLayoutEffect(() => field.current?.focus(), [time]); // before the next key is pressed: it belongs to the words
  if (time === undefined) return null;
  const send = async (event: Event): Promise<void> => {
    event.preventDefault();
    const text = field.current?.value.trim() ?? "";
    placing.value = undefined;
    const marker = await run(
      app,
      recordingsApi.markLater(replay.detail.info.id, { text, kind: "marker", time, device: "" }),
    );
    if (marker) replay.markers.value = [...replay.markers.peek(), marker];
  };
  const at = length(time - replay.bounds.first, 3);
  return (
    <form
      class="marker-form"
      onSubmit={(event) => void send(event)}
      onKeyDown={(event) => event.key === "Escape" && (placing.value = undefined)}
    >
      <label class="field">
        <span class="visually-hidden">{TEXT.markerAt(at)}</span>
        <input ref={field} maxLength={2000} placeholder={TEXT.markerAt(at)} />
      </label>
      <Button changes type="submit" look="main" words={COMMON.save} />
      <IconButton icon="close" label={TEXT.discardMarker} onClick={() => (placing.value = undefined)} />
    </form>
  );
}
