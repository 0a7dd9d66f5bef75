/** The grid of a chart: a line and a figure at each tick of both axes, and the line under the pointer. */
import { type Axis, type Tick, axisTicks } from "./axes";
import "./charts.css";

export interface ChartArea {
  /** px */
  readonly width: number;
  readonly height: number;
}

interface GridProps extends ChartArea {
  /** The axis along x, or its ticks. */
  readonly x: Axis | readonly Tick[];
  readonly y: Axis;
  /** Least room of a figure along each axis, px. */
  readonly room?: readonly [number, number];
}

const ROOM = [80, 32] as const;

export function Grid({ x, y, width, height, room = ROOM }: GridProps) {
  const fit = (length: number, each: number): number => Math.max(2, Math.floor(length / each));
  const across = "kind" in x ? axisTicks(x, fit(width, room[0])) : x;
  return (
    <g class="grid">
      {across.map(({ at, text }) => (
        <g key={`${text} ${at}`} transform={`translate(${at * width} 0)`}>
          <line y2={height} />
          <text y={height + 15} text-anchor="middle">
            {text}
          </text>
        </g>
      ))}
      {axisTicks(y, fit(height, room[1])).map(({ at, text }) => (
        <g key={text} transform={`translate(0 ${(1 - at) * height})`}>
          <line x2={width} />
          <text x={-8} dy="0.32em" text-anchor="end">
            {text}
          </text>
        </g>
      ))}
    </g>
  );
}

export function Crosshair({ x, height }: { readonly x: number; readonly height: number }) {
  return <line class="crosshair" x1={x} x2={x} y2={height} />;
}
