/** The frames to be sent, as annotated bytes: pointing at a row highlights the row, its bytes and its share. */
import { useState } from "preact/hooks";
import { Button } from "../ui/controls/button";
import { copyText } from "../ui/dom/copy";
import { chipsOf, spelled } from "./frame-chips";
import type { FrameInfo } from "../wire/form-types";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/forms";

interface Props {
  readonly frames: readonly FrameInfo[];
  /** Whether the value of this row differs from the device's. */
  readonly changed: (path: string) => boolean;
  readonly hot: string;
  readonly hover: (path: string) => void;
}

const MAX_FRAMES = 6;

export function BytesView({ frames, changed, hot, hover }: Props) {
  const [said, setSaid] = useState("");
  if (frames.length === 0) return null;
  const size = frames.reduce((sum, { hex }) => sum + hex.length / 2, 0);
  const hex = frames.map((frame) => frame.hex.toUpperCase().replace(/../g, "$& ").trim()).join("\n");
  const copy = async (): Promise<void> => {
    setSaid((await copyText(hex)) ? COMMON.copied : COMMON.notCopied);
    setTimeout(() => setSaid(""), 1500);
  };
  const pointedAt = frames.flatMap((frame) => (hot ? spelled(frame, hot) : []));
  return (
    <section class="hex-view" aria-label={TEXT.framePreview}>
      <div class="row">
        <h3>{TEXT.frameCount(frames.length)}</h3>
        <span class="dim beside">
          {TEXT.bytesToTheDevice(size)}
          {frames.some((frame) => chipsOf(frame).some(({ path }) => path && changed(path)))
            ? TEXT.changedBytesUnderlined
            : ""}
        </span>
        <span class="grow" />
        <Button look="small" words={said || TEXT.copyHex} onClick={() => void copy()} />
      </div>
      {frames.slice(0, MAX_FRAMES).map((frame, k) => (
        <Frame key={k} frame={frame} named={frames.length > 1} changed={changed} hot={hot} hover={hover} />
      ))}
      {frames.length > MAX_FRAMES && (
        <p class="dim hex-description flex-wrap mid text-xs">{TEXT.moreFrames(frames.length - MAX_FRAMES)}</p>
      )}
      <p class="hex-description flex-wrap mid text-xs" aria-hidden="true">
        {pointedAt.slice(0, 6).map(({ bytes, words }, k) => (
          <span key={k}>
            <span class="mono">{bytes}</span> {words}
          </span>
        ))}
      </p>
    </section>
  );
}

function Frame({
  frame,
  named,
  changed,
  hot,
  hover,
}: Omit<Props, "frames"> & { readonly frame: FrameInfo; readonly named: boolean }) {
  return (
    <>
      {named && <p class="dim hex-name text-xs">{frame.name}</p>}
      <div class="hex" onPointerLeave={() => hover("")}>
        {chipsOf(frame).map(({ key, bytes, words, path }) => (
          <span
            key={key}
            class={`hex-part ${path === "" ? "envelope" : ""} ${path && changed(path) ? "changed" : ""} ${path !== "" && (hot === path || hot.startsWith(`${path}.`)) ? "highlighted" : ""}`}
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
