/** The motion of a recording in a strip, with a mark wherever samples were lost. */
import { useEffect, useRef } from "preact/hooks";
import type { RecordingInfo } from "../../wire/recording-types";
import { css, surface } from "../../ui/dom/canvas";
import { theme } from "../../ui/dom/theme";
import { TEXT } from "../../texts/recordings";

/** A loss is never narrower than this, px. */
const LOSS_PX = 2;

export function Thumb({ info }: { readonly info: RecordingInfo }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const { thumbnail, losses } = info;
  const look = theme.value;
  useEffect(() => {
    if (!canvas.current) return undefined;
    const to = surface(canvas.current, draw);
    function draw(): void {
      if (!to.begin()) return;
      const [x, width, height] = [to.context, to.width(), to.height()];
      const step = width / Math.max(1, thumbnail.length);
      x.fillStyle = css("--ink-2");
      thumbnail.forEach((pair, i) => {
        const [a, b] = [pair[0] ?? 0, pair[1] ?? pair[0] ?? 0];
        const tall = Math.max(1.5, Math.max(a, b) * (height - 4));
        x.fillRect(i * step, (height - tall) / 2, Math.max(0.8, step * 0.7), tall);
      });
      if (thumbnail.length === 0) x.fillRect(0, height / 2 - 0.75, width, 1.5);
      x.fillStyle = css("--loss");
      for (const at of losses) x.fillRect(Math.min(width - LOSS_PX, at * width), 1, LOSS_PX, height - 2);
    }
    draw();
    return () => to.dispose();
  }, [thumbnail, losses, look]);
  const lost = losses.length === 0 ? "" : TEXT.lostInPlaces(losses.length);
  return (
    <div class="thumbnail">
      <canvas ref={canvas} role="img" aria-label={TEXT.motionOverTheRecording(lost)} />
    </div>
  );
}
