/** Markers and notes of a recording: where they are, a press jumps there, and more can be put in later. */
import { signal } from "@preact/signals";
import { useEffect, useLayoutEffect, useRef } from "preact/hooks";
import { length } from "../../recordings/library-filter";
import type { Replay } from "../../recordings/replay-controller";
import { server } from "../../recordings/api";
import { Icon } from "../../ui/icons";
import { run, sheet } from "../app-state";

/** Where a marker is being put, unix s. */
export const placing = signal<number | undefined>(undefined);

export function beginMarker(replay: Replay): void {
  placing.value = replay.head;
}

export function Markers({ replay }: { readonly replay: Replay }) {
  const markers = [...replay.markers.value].sort((a, b) => a.time - b.time);
  return (
    <section aria-label="Markers" class="markers">
      <div class="head also">
        <h3>Markers</h3>
        <span>{markers.length}</span>
        <span class="grow" />
        <button type="button" class="btn icon" aria-label="Put a marker here" title="Put a marker here (M)" onClick={() => beginMarker(replay)}>
          <Icon name="plus" />
        </button>
      </div>
      {markers.length === 0 && <p class="foot-note dim">No markers yet. Press M, or +, to add one at the cursor.</p>}
      <ol>
        {markers.map(({ id, time, kind, text }) => (
          <li key={id}>
            <button
              type="button"
              onClick={() => {
                replay.seek(time);
                sheet.value = undefined;
              }}
            >
              <time>{length(time - replay.bounds.first, 1)}</time>
              <span>{text || (kind === "note" ? "note" : "marker")}</span>
            </button>
          </li>
        ))}
      </ol>
    </section>
  );
}

/** The words of a marker; none will do. Enter keeps it, Esc does not. */
export function MarkerField({ replay }: { readonly replay: Replay }) {
  const field = useRef<HTMLInputElement>(null);
  const time = placing.value;
  useLayoutEffect(() => field.current?.focus(), [time]); // before the next key is pressed: it belongs to the words
  useEffect(
    () => () => {
      placing.value = undefined;
    },
    [],
  );
  if (time === undefined) return null;
  const send = async (event: Event): Promise<void> => {
    event.preventDefault();
    const text = field.current?.value.trim() ?? "";
    placing.value = undefined;
    const marker = await run(server.markLater(replay.detail.info.id, { text, kind: "marker", time, device: "" }));
    if (marker) replay.markers.value = [...replay.markers.peek(), marker];
  };
  const at = length(time - replay.bounds.first, 3);
  return (
    <form class="markfield" onSubmit={(event) => void send(event)} onKeyDown={(event) => event.key === "Escape" && (placing.value = undefined)}>
      <label class="field">
        <span class="vh">Marker at {at}</span>
        <input ref={field} maxLength={2000} placeholder={`Marker at ${at}`} />
      </label>
      <button type="submit" class="btn main">
        Keep
      </button>
      <button type="button" class="btn icon" aria-label="No marker" onClick={() => (placing.value = undefined)}>
        <Icon name="close" />
      </button>
    </form>
  );
}
