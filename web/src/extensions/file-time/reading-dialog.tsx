/** The dialog of a table: its first rows as they will be read, and everything about them that can be chosen. */
import { useSignal, type Signal } from "@preact/signals";
import { useRef } from "preact/hooks";
import { dateWords } from "../../recordings/library-filter";
import { Button } from "../../ui/controls/button";
import { Segmented, Select } from "../../ui/controls/choices";
import { Dialog } from "../../ui/controls/dialog";
import { request, type HttpProblem } from "../../requests/http";
import { ProblemNote } from "../../requests/problem-note";
import { Answered, useAnswer } from "../../requests/use-answer";
import type { ReadingState, TablePreview, FileTime, PreviewColumn } from "../../wire/routes";
import { COMMON } from "../../texts/common";
import {
  COUNT_ROWS,
  samplingWords,
  readingOf,
  timeChoices,
  unitOption,
  withTimes,
  choiceOf,
  withColumn,
  previewCell,
  decimalsAt,
  type Reading,
  type ColumnChoice,
} from "./reading";
import { TEXT } from "./texts";
import type { RecordingDialogProps } from "../../pages/recordings/open-recording";
import { reopen } from "./reopen";
import { clock } from "../../ui/format/format";
import "./reading.css";

/** Pause after which what is typed is shown, ms. */
const TYPED_MS = 200;

interface Props {
  /** RecordingInfo.id */
  readonly recording: string;
  /** Name of its file. */
  readonly title: string;
  readonly state: Pick<ReadingState, "reading" | "is_chosen">;
  readonly onClose: () => void;
  /** It is read otherwise from now on. */
  readonly onChosen: () => void;
}

export function ReadingDialog({ recording, title, state, onClose, onChosen }: Props) {
  const reading = useSignal<Reading>(readingOf(state.reading));
  const problem = useSignal<HttpProblem | undefined>(undefined);
  const busy = useSignal(false);
  const path = { recording };
  const body = reading.value;
  const preview = useAnswer(
    JSON.stringify([recording, body]),
    (signal) => request("POST /api/recordings/{recording}/reading/preview", { path, body, signal }),
    { typedMs: TYPED_MS },
  );
  const choose = async (isAutomatic: boolean): Promise<void> => {
    if (busy.value) return;
    busy.value = true;
    const outcome = isAutomatic
      ? await request("DELETE /api/recordings/{recording}/reading", { path })
      : await request("PUT /api/recordings/{recording}/reading", { path, body: reading.value });
    busy.value = false;
    if (outcome.ok) onChosen();
    else problem.value = outcome.problem;
  };
  const last = useRef<TablePreview | undefined>(undefined);
  const table = (last.current = preview.answer ?? last.current); // an answer that is refused leaves what can be chosen
  return (
    <Dialog title={TEXT.readingOf(title)} onClose={onClose}>
      <form
        class="table-reading stacked form"
        autocomplete="off"
        onSubmit={(event) => {
          event.preventDefault();
          void choose(false);
        }}
      >
        {table && <Question table={table} />}
        {table && <Choices table={table} reading={reading} />}
        {problem.value && <ProblemNote problem={problem.value} />}
        <Answered of={preview} waiting={<p class="dim">{TEXT.loadingRows}</p>}>
          {(shown) => (
            <>
              <Facts table={shown} />
              <FirstRows table={shown} />
            </>
          )}
        </Answered>
        {table && <ColumnNames table={table} reading={reading} />}
        <div class="row">
          <span class="grow dim">{TEXT.remembered}</span>
          {state.is_chosen && (
            <Button
              changes
              look="edge"
              words={TEXT.automatic}
              title={TEXT.automaticHint}
              onClick={() => void choose(true)}
            />
          )}
          <Button look="edge" words={COMMON.cancel} onClick={onClose} />
          <Button
            changes
            type="submit"
            look="main"
            words={TEXT.readSo}
            disabled={busy.value || !table || table.about !== ""}
          />
        </div>
      </form>
    </Dialog>
  );
}

/** The open question, until it is answered. */
function Question({ table }: { readonly table: TablePreview }) {
  if (table.about === "") return null;
  const words = table.about === "rate" ? table.problem : TEXT.questions[table.about](table.clock);
  return (
    <p class="hint table-question" role="status">
      {words}
    </p>
  );
}

interface ChoicesProps {
  readonly table: TablePreview;
  readonly reading: Signal<Reading>;
}

function Choices({ table, reading }: ChoicesProps) {
  const { value } = reading;
  const set = (part: Partial<Reading>): void => void (reading.value = { ...reading.peek(), ...part });
  const isCounted = value.time_column === COUNT_ROWS;
  const column = value.time_column || table.time_column;
  const asksOrder = table.about === "order" || value.date_order !== "";
  return (
    <div class="table-choices flex-wrap">
      <div>
        <label for="table-times">{TEXT.timeColumn}</label>
        <Select
          id="table-times"
          value={column}
          none={TEXT.chooseColumn}
          options={[...timeChoices(table, value.columns), [COUNT_ROWS, TEXT.countRows]]}
          onChoose={(option) => (reading.value = withTimes(reading.peek(), option))}
        />
      </div>
      {isCounted && (
        <div>
          <label for="table-rate">{TEXT.samplesPerSecond}</label>
          <div class="field">
            <input
              id="table-rate"
              type="text"
              inputMode="decimal"
              value={value.rate || ""}
              onInput={(event) => set({ rate: Math.max(0, Number(event.currentTarget.value.replace(",", ".")) || 0) })}
            />
            <span class="unit">Hz</span>
          </div>
        </div>
      )}
      {!isCounted && table.units.length > 0 && <Units table={table} reading={reading} />}
      {!isCounted && table.packet_stamp !== "" && (
        <div>
          <span class="label">{TEXT.packetStamp}</span>
          <Segmented
            label={TEXT.packetStamp}
            value={table.packet_stamp}
            options={(["first", "last"] as const).map((stamp) => [stamp, TEXT.packetStamps[stamp]])}
            onChoose={(stamp) => set({ packet_stamp: stamp })}
          />
        </div>
      )}
      {asksOrder && (
        <div>
          <span class="label">{TEXT.dateOrder}</span>
          <Segmented
            label={TEXT.dateOrder}
            value={value.date_order || undefined}
            options={(["dmy", "mdy"] as const).map((order) => [order, TEXT.orders[order]])}
            onChoose={(order) => set({ date_order: order })}
          />
        </div>
      )}
    </div>
  );
}

/** The units, each with the sampling rate that it gives. */
function Units({ table, reading }: ChoicesProps) {
  const chosen = reading.value.unit || unitOption(table.unit);
  return (
    <div>
      <span class="label">{TEXT.unitOf(table.clock)}</span>
      <div class="segmented table-units" role="group" aria-label={TEXT.unitOf(table.clock)}>
        {table.units.map(({ unit, rate, is_plausible }) => (
          <button
            type="button"
            key={unit}
            class={is_plausible ? "" : "unlikely"}
            aria-pressed={chosen === unitOption(unit)}
            onClick={() => (reading.value = { ...reading.peek(), unit: unitOption(unit), rate: 0 })}
          >
            <b>{unit}</b>
            <span>{rate === null ? TEXT.none : samplingWords(rate, TEXT.oneIn)}</span>
          </button>
        ))}
      </div>
    </div>
  );
}

/** Form of the file, and the axis in words. */
function Facts({ table }: { readonly table: TablePreview }) {
  const [first] = table.times;
  const facts = [
    TEXT.separatedBy(TEXT.separators[table.separator] ?? table.separator),
    table.decimal === "," ? TEXT.decimalComma : TEXT.decimalPoint,
    ...(table.rate === null ? [] : [samplingWords(table.rate, TEXT.oneIn)]),
    ...(first === null || first === undefined ? [] : [TEXT.startsAt(dateWords(first, true))]),
  ];
  return (
    <div class="table-facts text-sm">
      <p>{facts.join(" · ")}</p>
      {table.sentences.map((sentence) => (
        <p key={sentence} class="dim">
          {sentence}
        </p>
      ))}
    </div>
  );
}

export function RecordingReading({ recording, onClose }: RecordingDialogProps) {
  const { info } = recording.replay.detail;
  const state = recording.app.subject.value as Pick<FileTime, "reading" | "is_chosen"> | undefined;
  if (state === undefined) return null;
  const onChosen = (): void => {
    onClose();
    reopen(info.id);
  };
  return <ReadingDialog recording={info.id} title={info.file} state={state} onClose={onClose} onChosen={onChosen} />;
}

interface ColumnNamesProps {
  readonly table: TablePreview;
  readonly reading: Signal<Reading>;
}

function ColumnNames({ table, reading }: ColumnNamesProps) {
  const columns = table.columns.filter(({ role }) => role === "value" || role === "left out");
  return (
    <details class="table-columns">
      <summary>{TEXT.columnNames}</summary>
      <p class="dim">{TEXT.columnNamesHint}</p>
      <ul>
        {columns.map((column) => (
          <Column key={column.number} column={column} reading={reading} />
        ))}
      </ul>
    </details>
  );
}

function Column({ column, reading }: { readonly column: PreviewColumn; readonly reading: Signal<Reading> }) {
  const { number, heading } = column;
  const title = heading === "" ? TEXT.columnNumber(number) : heading;
  const own = useSignal(choiceOf(column)); // the preview follows later
  const choice = own.value;
  const set = (part: Partial<ColumnChoice>): void => {
    own.value = { ...own.peek(), ...part };
    reading.value = withColumn(reading.peek(), column, own.peek());
  };
  return (
    <li>
      <label class="flag">
        <input
          type="checkbox"
          class="check"
          checked={choice.isRead}
          onChange={(event) => set({ isRead: event.currentTarget.checked })}
        />
        <span>{title}</span>
      </label>
      <div class="field">
        <input
          type="text"
          aria-label={TEXT.nameOf(title)}
          value={choice.name}
          disabled={!choice.isRead}
          spellcheck={false}
          onChange={(event) => set({ name: event.currentTarget.value })}
        />
      </div>
      <div class="field unit-field">
        <input
          type="text"
          aria-label={TEXT.unitOf(title)}
          placeholder={TEXT.unit}
          value={choice.unit}
          disabled={!choice.isRead}
          spellcheck={false}
          onChange={(event) => set({ unit: event.currentTarget.value })}
        />
      </div>
    </li>
  );
}

/** A column with its place in the rows, or several of one vector. */
interface Group {
  readonly name: string;
  readonly columns: readonly (readonly [number, PreviewColumn])[];
}

/** Columns in the order of the file; those of a vector stand together, where its first one is. */
export function groupsOf(columns: readonly PreviewColumn[]): readonly Group[] {
  const groups = new Map<string, [number, PreviewColumn][]>();
  columns.forEach((column, place) => {
    if (column.role === "left out") return;
    const key = column.group === "" ? `column ${place}` : `vector ${column.group}`;
    groups.set(key, [...(groups.get(key) ?? []), [place, column]]);
  });
  return [...groups.values()].map((members) => {
    const inOrder = members.toSorted(([, a], [, b]) => a.axis.localeCompare(b.axis));
    return { name: members[0]?.[1].group ?? "", columns: inOrder };
  });
}

/** The first rows of a table as they will be read: the time of each, then its columns, those of a vector under its name. */
function FirstRows({ table }: { readonly table: TablePreview }) {
  const groups = groupsOf(table.columns);
  const inOrder = groups.flatMap(({ columns }) => columns);
  return (
    <div class="table-rows text-sm" tabIndex={0} role="region" aria-label={TEXT.firstRows}>
      <table>
        <thead>
          <tr>
            <th rowSpan={2} class="time">
              {TEXT.timeUtc}
            </th>
            {groups.map(({ name, columns }) =>
              name === "" ? (
                columns.map(([place, column]) => (
                  <th key={place} rowSpan={2} class={column.role}>
                    <Heading column={column} name={column.name} />
                  </th>
                ))
              ) : (
                <th key={`v ${name}`} colSpan={columns.length} class="of-vector">
                  {name}
                </th>
              ),
            )}
          </tr>
          <tr>
            {groups
              .filter(({ name }) => name !== "")
              .flatMap(({ columns }) =>
                columns.map(([place, column]) => (
                  <th key={place}>
                    <Heading column={column} name={column.axis} />
                  </th>
                )),
              )}
          </tr>
        </thead>
        <tbody>
          {table.rows.map((row, at) => {
            const time = table.times[at] ?? null;
            return (
              <tr key={at}>
                <td class="time">{time === null ? TEXT.none : clock(time, decimalsAt(table.rate))}</td>
                {inOrder.map(([place, column]) => (
                  <td key={place} class={column.role}>
                    {previewCell(row[place] ?? null)}
                  </td>
                ))}
              </tr>
            );
          })}
        </tbody>
      </table>
    </div>
  );
}

function Heading({ column, name }: { readonly column: PreviewColumn; readonly name: string }) {
  return (
    <span title={column.heading}>
      {name} {column.unit !== "" && <span class="unit">{column.unit}</span>}
      {column.role === "time" && <span class="tag">{TEXT.axis}</span>}
      {column.role === "clock" && <span class="tag">{TEXT.otherClock}</span>}
    </span>
  );
}
