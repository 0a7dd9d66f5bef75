/** A sensor turned by its alignment, in the aligned axes, drawn as the instrument draws an attitude. */
import { useEffect, useRef } from "preact/hooks";
import { matrixIn, type Matrix3, type Vector3 } from "../data/rotations";
import { surface } from "../ui/dom/canvas";
import { theme } from "../ui/dom/theme";
import { number } from "../ui/format/format";
import { drawBody } from "./body";
import { TEXT } from "../texts/attitude";

interface Props {
  /** Aligned from sensor, with its angles in °; undefined if the numbers are no rotation. */
  readonly turn: { readonly angles: Vector3; readonly matrix: Matrix3 } | undefined;
  /** Of the body: which of them points down. */
  readonly axes: "FLU" | "FRD";
}

export function TurnPicture({ turn, axes }: Props) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const colours = theme.value;
  // biome-ignore lint/correctness/useExhaustiveDependencies: the canvas reads the colours of the theme itself
  useEffect(() => {
    if (!canvas.current?.getContext("2d")) return undefined;
    const frame = axes === "FRD" ? "NED" : "NWU";
    const enu = turn && matrixIn(turn.matrix, frame, "ENU");
    const on = surface(canvas.current, () => drawBody(on, enu, frame, "xyz"));
    return () => on.dispose();
  }, [colours, axes, turn?.matrix.join()]);
  const [roll = "", pitch = "", yaw = ""] = (turn?.angles ?? []).map((angle) => number(angle, 0));
  return (
    <figure>
      <canvas ref={canvas} role="img" aria-label={turn ? TEXT.sensorTurned(roll, pitch, yaw) : TEXT.noRotation} />
      <figcaption class="dim text-xs">{turn ? TEXT.sensorAxes : TEXT.noRotation}</figcaption>
    </figure>
  );
}
