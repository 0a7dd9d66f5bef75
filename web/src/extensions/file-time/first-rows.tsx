/** The first rows of a table as they will be read: the time of each, then its columns, those of a vector under its name. */
import { clock } from "../../ui/format/format";
import type { PreviewColumn, TablePreview } from "../../wire/routes";
import { previewCell, decimalsAt } from "./reading";
import { TEXT } from "./texts";

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

export function FirstRows({ table }: { readonly table: TablePreview }) {
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
