/** The frames that would be sent, as annotated bytes: pointing at a row, its bytes or its share lights all three. */
import { useState } from "preact/hooks";
import { chipsOf, spelled } from "./frame-chips";
import type { FrameInfo } from "./types";

interface Props {
  readonly frames: readonly FrameInfo[];
  /** Is the value of this row another than what the device has? */
  readonly changed: (path: string) => boolean;
  readonly hot: string;
  readonly hover: (path: string) => void;
}

const MOST_FRAMES = 6;

export function BytesView({ frames, changed, hot, hover }: Props) {
  const [copied, setCopied] = useState(false);
  if (frames.length === 0) return null;
  const size = frames.reduce((sum, { hex }) => sum + hex.length / 2, 0);
  const hex = frames.map((frame) => frame.hex.toUpperCase().replace(/../g, "$& ").trim()).join("\n");
  const copy = async (): Promise<void> => {
    await copyText(hex);
    setCopied(true);
    setTimeout(() => setCopied(false), 1500);
  };
  const said = frames.flatMap((frame) => (hot ? spelled(frame, hot) : []));
  return (
    <section class="hexbox" aria-label="Frame preview">
      <div class="row">
        <h3>{frames.length === 1 ? "Frame" : `${frames.length} frames`}</h3>
        <span class="dim beside">
          {size} bytes to the device{frames.some((frame) => chipsOf(frame).some(({ path }) => path && changed(path))) ? ", changed ones underlined" : ""}
        </span>
        <span class="grow" />
        <button type="button" class="btn small" onClick={() => void copy()}>
          {copied ? "Copied" : "Copy hex"}
        </button>
      </div>
      {frames.slice(0, MOST_FRAMES).map((frame, k) => (
        <Frame key={k} frame={frame} named={frames.length > 1} changed={changed} hot={hot} hover={hover} />
      ))}
      {frames.length > MOST_FRAMES && <p class="dim hexsay">… and {frames.length - MOST_FRAMES} more frames.</p>}
      <p class="hexsay" aria-hidden="true">
        {said.slice(0, 6).map(({ bytes, words }, k) => (
          <span key={k}>
            <span class="mono">{bytes}</span> {words}
          </span>
        ))}
      </p>
    </section>
  );
}

function Frame({ frame, named, changed, hot, hover }: Omit<Props, "frames"> & { readonly frame: FrameInfo; readonly named: boolean }) {
  return (
    <>
      {named && <p class="dim hexname">{frame.name}</p>}
      <div class="hex" onPointerLeave={() => hover("")}>
        {chipsOf(frame).map(({ key, bytes, words, path }) => (
          <span
            key={key}
            class={`hx ${path === "" ? "env" : ""} ${path && changed(path) ? "ch" : ""} ${path !== "" && (hot === path || hot.startsWith(`${path}.`)) ? "hot" : ""}`}
            onPointerEnter={() => hover(path)}
          >
            {bytes}
            <small>{words}</small>
          </span>
        ))}
      </div>
    </>
  );
}

/** The clipboard of the browser exists on secure origins only; a robot's plain address is none. */
async function copyText(text: string): Promise<void> {
  try {
    await navigator.clipboard.writeText(text);
  } catch {
    const area = document.createElement("textarea");
    area.value = text;
    document.body.append(area);
    area.select();
    document.execCommand("copy");
    area.remove();
  }
}
