/** A chart of figures against frequency or averaging time: curves with bands, marks, and a reading under the pointer. */
import { useSignal } from "@preact/signals";
import { type Axis, axisOf, curve, figure, type Kind, nearest, type Point, share } from "../../charts/axes";
import { Chart, chartClass, useChart, valueUnder } from "../../charts/chart";
import { type ChartArea, Crosshair } from "../../charts/grid";

export type CurveNumbers = readonly (number | null)[];

export interface ChartCurve {
  readonly name: string;
  readonly colour: string;
  readonly x: CurveNumbers;
  readonly y: CurveNumbers;
  /** Ends of an interval around the curve. */
  readonly low?: CurveNumbers;
  readonly high?: CurveNumbers;
  /** A dashed curve beside it. */
  readonly model?: CurveNumbers;
  /** A dotted curve without a colour, to compare with. */
  readonly reference?: CurveNumbers;
}

interface Props {
  readonly label: string;
  readonly curves: readonly ChartCurve[];
  readonly xKind: Kind;
  readonly xTitle: string;
  readonly xUnit: string;
  readonly yTitle: string;
  readonly yUnit: string;
  /** Values of x with a mark and a word. */
  readonly marks?: readonly { readonly x: number; readonly text: string }[];
}

const MARGINS = { left: 64, right: 12, top: 18, bottom: 40 };
const CHART_PX = 340;

export function FigureChart({ label, curves, xKind, xTitle, xUnit, yTitle, yUnit, marks = [] }: Props) {
  const size = useChart(MARGINS, CHART_PX);
  const { area } = size;
  const pointer = useSignal<number | undefined>(undefined);
  const x = axisOf(
    xKind,
    curves.flatMap((one) => one.x),
  );
  const y = axisOf(
    "log",
    curves.flatMap((one) => [...one.y, ...(one.low ?? []), ...(one.high ?? []), ...(one.reference ?? [])]),
  );
  if (!x || !y) return <div class={chartClass("analysis-chart")} ref={size.host} />;
  return (
    <div
      class={chartClass("analysis-chart")}
      ref={size.host}
      onPointerMove={(event) => (pointer.value = valueUnder(size, x, event))}
      onPointerLeave={() => (pointer.value = undefined)}
    >
      <Chart
        size={size}
        label={label}
        x={x}
        y={y}
        xTitle={`${xTitle} ${xUnit}`}
        yTitle={`${yTitle} ${yUnit}`}
        yTitleX={MARGINS.left}
      >
        <svg {...area} overflow="hidden">
          {curves.map((one) => (
            <Drawn key={one.name} curve={one} axes={{ x, y }} {...area} />
          ))}
        </svg>
        {placed(marks, x, area.width).map((mark) => (
          <Mark key={mark.x} {...mark} {...area} />
        ))}
        {pointer.value !== undefined && <Crosshair x={share(x, pointer.value) * area.width} {...area} />}
      </Chart>
      <Reading curves={curves} at={pointer.value} xUnit={xUnit} yUnit={yUnit} />
    </div>
  );
}

interface DrawnProps extends ChartArea {
  readonly curve: ChartCurve;
  readonly axes: { readonly x: Axis; readonly y: Axis };
}

function Drawn({ curve: one, axes, width, height }: DrawnProps) {
  const parts = curve(one.x, one.y, axes, width, height);
  const above = one.high ? curve(one.x, one.high, axes, width, height) : [];
  const below = one.low ? curve(one.x, one.low, axes, width, height) : [];
  const model = one.model ? curve(one.x, one.model, axes, width, height) : [];
  const reference = one.reference ? curve(one.x, one.reference, axes, width, height) : [];
  return (
    <g class={one.colour}>
      {above.length > 0 && (
        <path
          class="interval"
          d={above.map((part, i) => `${path(part)}${path([...(below[i] ?? [])].reverse(), "L")}Z`).join("")}
        />
      )}
      {model.length > 0 && <path class="model" d={joined(model)} />}
      {reference.length > 0 && <path class="reference" d={joined(reference)} />}
      {parts.length > 0 && <path class="trace" d={joined(parts)} />}
    </g>
  );
}

const joined = (parts: readonly (readonly Point[])[]): string => parts.map((part) => path(part)).join("");

function path(points: readonly Point[], first = "M"): string {
  return points.map(([x, y], i) => `${i === 0 ? first : "L"}${x.toFixed(1)} ${y.toFixed(1)}`).join("");
}

interface Placed {
  readonly x: number;
  readonly at: number;
  /** "" where another word is too near. */
  readonly text: string;
}

const WORD_PX = 52;

/** Marks on the axis from left to right, with words where there is room. */
function placed(marks: NonNullable<Props["marks"]>, axis: Axis, width: number): readonly Placed[] {
  let free = 0;
  return marks
    .map(({ x, text }) => ({ x, text, at: share(axis, x) * width }))
    .filter(({ at }) => at >= 0 && at <= width)
    .sort((a, b) => a.at - b.at)
    .map((mark) => {
      const begin = mark.at > width - WORD_PX ? mark.at - WORD_PX : mark.at;
      if (begin < free) return { ...mark, text: "" };
      free = begin + WORD_PX;
      return mark;
    });
}

function Mark({ at, text, width, height }: Placed & ChartArea) {
  const isRight = at > width - WORD_PX;
  return (
    <g class="mark" transform={`translate(${at} 0)`}>
      <line y2={height} />
      <text x={isRight ? -4 : 4} y={10} text-anchor={isRight ? "end" : "start"}>
        {text}
      </text>
    </g>
  );
}

interface ReadingProps {
  readonly curves: readonly ChartCurve[];
  readonly at: number | undefined;
  readonly xUnit: string;
  readonly yUnit: string;
}

/** The figures under the pointer; the curves' names without one. */
function Reading({ curves, at, xUnit, yUnit }: ReadingProps) {
  const first = curves[0];
  const i = at === undefined || !first ? -1 : nearest(first.x, at);
  return (
    <p class="chart-reading analysis-reading">
      {i >= 0 && (
        <b>
          {figure(first?.x[i])} {xUnit}
        </b>
      )}
      {curves.map((one) => (
        <span key={one.name}>
          <i class={one.colour}>{one.name}</i>
          {i >= 0 && ` ${figure(one.y[i])} ${yUnit}`}
        </span>
      ))}
    </p>
  );
}
