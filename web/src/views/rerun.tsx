/**
 * A recording in Rerun's viewer, in a frame over the player: one click, and gone when it is closed. What it opens is the loop range
 * where one is set, else the whole recording; the frame's own address is a link that opens straight into it.
 */
import { signal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import type { Replay } from "../recordings/replay-controller";
import { Icon } from "../ui/icons";
import { theme } from "../ui/theme";
import { viewerHref } from "./viewer-href";
import "./rerun.css";

/** The address that the frame shows; undefined while it is closed. */
const shown = signal<string>();

/** Opens what is chosen of a recording. */
export function RerunButton({ replay }: { readonly replay: Replay }) {
  const open = (): void => {
    const loop = replay.looping.peek() ? replay.loop.peek() : undefined;
    shown.value = viewerHref(replay.detail.info.id, loop, theme.peek());
  };
  return (
    <button type="button" class="btn edge" title="Look at it in the Rerun viewer, here: the loop range, or all of it" onClick={open}>
      <Icon name="cube" />
      Open in Rerun
    </button>
  );
}

/** The frame, over everything else of the page. */
export function RerunPanel() {
  const whole = useRef<HTMLElement>(null);
  const address = shown.value;
  useEffect(() => () => void (shown.value = undefined), []);
  if (address === undefined) return null;
  const enlarge = (): void => {
    if (document.fullscreenElement) void document.exitFullscreen();
    else void whole.current?.requestFullscreen?.().catch(() => undefined);
  };
  return (
    <section class="rerun" ref={whole} aria-label="Rerun viewer">
      <div class="head">
        <h2>Rerun</h2>
        <span class="grow" />
        <a class="btn small" href={address} target="_blank" rel="noopener" title="Open it in a tab of its own; its address can be shared">
          Own tab
        </a>
        {document.fullscreenEnabled && (
          <button type="button" class="btn icon" aria-label="Full screen" title="Full screen, and back (Esc)" onClick={enlarge}>
            <Icon name="fit" />
          </button>
        )}
        <button type="button" class="btn icon" aria-label="Close Rerun" title="Close Rerun" onClick={() => (shown.value = undefined)}>
          <Icon name="close" />
        </button>
      </div>
      <iframe src={address} title="Rerun viewer" allow="fullscreen" />
    </section>
  );
}
