/** The head of a table, a cell for each column. */
import type { ComponentChildren } from "preact";

interface Head {
  readonly text: ComponentChildren;
  readonly class?: string;
  readonly title?: string | undefined;
  readonly "data-column"?: string;
  readonly "aria-sort"?: "ascending" | "descending" | "none";
}

interface Props {
  /** "": above the names of rows. */
  readonly of: readonly (string | Head)[];
}

export function TableHead({ of }: Props) {
  return (
    <thead>
      <tr>
        {of.map((one, column) => {
          const { text, ...rest } = typeof one === "string" ? { text: one } : one;
          const named = text !== "" ? { scope: "col" as const } : {};
          return (
            <th key={column} {...named} {...rest}>
              {text}
            </th>
          );
        })}
      </tr>
    </thead>
  );
}
