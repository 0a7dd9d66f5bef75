/** What the widgets of a form need to know: values, what they were, what is wrong, and where a new value goes. */
import type { FieldProblem } from "./types";
import { joined, type Path, type Values } from "./values";

export interface Sheet {
  /** Unique on the page: begins the ids of its controls. */
  readonly id: string;
  readonly values: Values;
  /** What the device has; undefined where that is not known, or means nothing (arguments of a command). */
  readonly before: Values | undefined;
  readonly problems: readonly FieldProblem[];
  readonly readOnly: boolean;
  /** Also what most people never change. */
  readonly all: boolean;
  readonly set: (path: Path, value: unknown) => void;
  /** What was typed is no value: why, or undefined when it is one again. */
  readonly wrong: (path: Path, why: string | undefined) => void;
  /** The row under the pointer or the focus; "" when it leaves. */
  readonly hover: (path: string) => void;
  /** Texts to choose from, by path, where the device or its product is known to take these. */
  readonly options: Readonly<Record<string, readonly string[]>>;
  /** What a search or a link asked for, shown also where it is not simple: the name of a field, the number of a table's row; "" for nothing. */
  readonly sought: string;
  /** Another number: edits were discarded, and what was typed is forgotten with them. */
  readonly epoch: number;
}

/** What the server says of a path, or of anything inside it. */
export function problemAt(sheet: Sheet, path: Path): FieldProblem | undefined {
  const own = joined(path);
  return sheet.problems.find((problem) => problem.path === own || problem.path.startsWith(`${own}.`));
}

/** For labels, hints and tests: the id of the control at a path. */
export const idOf = (sheet: Sheet, path: Path): string => `${sheet.id}-${joined(path)}`.replace(/[^\w-]+/g, "-");
