/** Pictures of an answer: points of one column over another, and the histogram of a column. */
import { useSignal } from "@preact/signals";
import { type Axis, axisOf, figure, share } from "../../../charts/axes";
import { Chart, chartClass, pointIn, useChart } from "../../../charts/chart";
import { Select } from "../../../ui/controls/choices";
import type { QueryAnswer } from "../../../wire/routes";
import { countedBins, chartGroups, numbersOf, pictureOf, positionsOf, positionText } from "./chart-data";
import type { Questions } from "./state";
import { TEXT } from "./texts";

/** Least room of a figure along each axis, px. */
const ROOM = [80, 40] as const;
const MARGINS = { left: 72, right: 16, top: 16, bottom: 40 };
const MAX_POINTS = 20_000;
const NEAR_PX = 24;

interface Props {
  readonly state: Questions;
  readonly answer: QueryAnswer;
}

export function AnswerPlot({ state, answer }: Props) {
  const size = useChart(MARGINS);
  const { area: inner } = size;
  const pointed = useSignal(-1);
  const choice = state.choice.value;
  if (!choice) return <p class="answer-none dim">{TEXT.noNumbers}</p>;
  const { columns } = answer;
  const rows = answer.rows.slice(0, MAX_POINTS);
  const picture = pictureOf(columns, rows, choice);
  const nameOf = (at: number): string => columns[at]?.name ?? "";
  const all = picture?.groups.flatMap(({ points }) => points) ?? [];
  const place = ([x, y]: readonly [number, number, number]): readonly [number, number] =>
    picture ? [share(picture.x, x) * inner.width, (1 - share(picture.y, y)) * inner.height] : [0, 0];
  const move = (event: PointerEvent): void => {
    const [px, py] = pointIn(size, event);
    let [best, least] = [-1, NEAR_PX];
    for (const point of all) {
      const [x, y] = place(point);
      const off = Math.hypot(x - px, y - py);
      if (off < least) [best, least] = [point[2], off];
    }
    pointed.value = best;
  };
  const row = rows[pointed.value];
  const set = (part: "x" | "y" | "group") => (at: number) => {
    state.choice.value = { ...choice, [part]: at };
    pointed.value = -1;
  };
  const groups = chartGroups(columns, rows);
  const reading =
    row && picture
      ? [choice.x, choice.y, ...(choice.group >= 0 ? [choice.group] : [])]
          .map((at) => `${nameOf(at)} ${positionText(columns[at], row, at)}`)
          .join(" · ")
      : TEXT.pointAtChart;
  return (
    <>
      <div class="control-row">
        <AnswerSelect label={TEXT.x} value={choice.x} all={positionsOf(columns)} nameOf={nameOf} onChange={set("x")} />
        <AnswerSelect label={TEXT.y} value={choice.y} all={numbersOf(columns)} nameOf={nameOf} onChange={set("y")} />
        {groups.length > 0 && (
          <AnswerSelect
            label={TEXT.group}
            value={choice.group}
            all={[-1, ...groups]}
            nameOf={(at) => (at < 0 ? TEXT.noGroup : nameOf(at))}
            onChange={set("group")}
          />
        )}
      </div>
      <div
        class={chartClass("answer-chart")}
        ref={size.host}
        onPointerMove={move}
        onPointerLeave={() => (pointed.value = -1)}
      >
        {picture && (
          <Chart
            size={size}
            label={TEXT.chart(nameOf(choice.y), nameOf(choice.x))}
            x={picture.xTicks(Math.max(2, Math.floor(inner.width / 96)))}
            y={picture.y}
            room={ROOM}
            xTitle={columns[choice.x]?.kind === "time" ? TEXT.inUtc(nameOf(choice.x)) : nameOf(choice.x)}
            yTitle={nameOf(choice.y)}
          >
            {picture.groups.map(({ name, points, colour }) => (
              <path
                key={name}
                class={`points ${colour}`}
                d={points
                  .map((one) => place(one))
                  .map(([x, y]) => ["M", x.toFixed(1), ",", y.toFixed(1), "h0"].join(""))
                  .join("")}
              />
            ))}
          </Chart>
        )}
      </div>
      <p class="chart-reading">
        <span>{reading}</span>
        {picture &&
          picture.groups.length > 1 &&
          picture.groups.map(({ name, colour }) => (
            <span key={name} class={`answer-legend ${colour}`}>
              {name || "—"}
            </span>
          ))}
        {picture && picture.left > 0 && <span class="dim">{TEXT.leftOut(picture.left)}</span>}
      </p>
    </>
  );
}

export function AnswerHistogram({ state, answer }: Props) {
  const size = useChart(MARGINS);
  const { area: inner } = size;
  const pointed = useSignal(-1);
  const { columns, rows } = answer;
  const column = state.column.value;
  const bins = column >= 0 ? countedBins(rows, column) : [];
  const nameOf = (at: number): string => columns[at]?.name ?? "";
  const x = axisOf(
    "linear",
    bins.flatMap(({ low, high }) => [low, high]),
  );
  if (!x) return <p class="answer-none dim">{TEXT.noNumbers}</p>;
  const y: Axis = { kind: "linear", low: 0, high: Math.max(...bins.map(({ count }) => count)) * 1.05 };
  const move = (event: PointerEvent): void => {
    const at = pointIn(size, event)[0] / inner.width;
    pointed.value = at >= 0 && at < 1 ? Math.floor(at * bins.length) : -1;
  };
  const bin = bins[pointed.value];
  return (
    <>
      <div class="control-row">
        <AnswerSelect
          label={TEXT.column}
          value={column}
          all={numbersOf(columns)}
          nameOf={nameOf}
          onChange={(at) => (state.column.value = at)}
        />
      </div>
      <div
        class={chartClass("answer-chart")}
        ref={size.host}
        onPointerMove={move}
        onPointerLeave={() => (pointed.value = -1)}
      >
        <Chart
          size={size}
          label={TEXT.histogramOf(nameOf(column))}
          x={x}
          y={y}
          room={ROOM}
          xTitle={nameOf(column)}
          yTitle={TEXT.rowCount}
        >
          {bins.map(({ low, high, count }, k) => {
            const [from, to, top] = [
              share(x, low) * inner.width,
              share(x, high) * inner.width,
              share(y, count) * inner.height,
            ];
            return (
              <rect
                key={low}
                class={k === pointed.value ? "bin pointed" : "bin"}
                x={from}
                y={inner.height - top}
                width={Math.max(0.5, to - from - 1)}
                height={top}
              />
            );
          })}
        </Chart>
      </div>
      <p class="chart-reading">
        {bin ? TEXT.binReading(figure(bin.low), figure(bin.high), bin.count) : TEXT.pointAtChart}
      </p>
    </>
  );
}

interface SelectProps {
  readonly label: string;
  readonly value: number;
  readonly all: readonly number[];
  readonly nameOf: (at: number) => string;
  readonly onChange: (at: number) => void;
}

function AnswerSelect({ label, value, all, nameOf, onChange }: SelectProps) {
  return (
    <label class="answer-choice mid text-sm">
      {label}
      <Select value={value} options={all.map((at) => [at, nameOf(at)])} onChoose={onChange} />
    </label>
  );
}
