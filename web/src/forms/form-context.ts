/** Context of a form's widgets: values, previous values, problems, and the callback for new values. */
import type { FieldProblem, Forms } from "../wire/form-types";
import { joined, type Path, type FormValues } from "./values";

export interface FormContext {
  /** Unique on the page: begins the ids of its controls. */
  readonly id: string;
  readonly values: FormValues;
  /** Values on the device; undefined if unknown or meaningless (arguments of a command). */
  readonly before: FormValues | undefined;
  readonly problems: readonly FieldProblem[];
  readonly readOnly: boolean;
  /** Whether rarely used fields are shown too. */
  readonly all: boolean;
  readonly set: (path: Path, value: unknown) => void;
  /** Reports why a typed text is not a value, or undefined when it is one again. */
  readonly wrong: (path: Path, why: string | undefined) => void;
  /** The row under the pointer or the focus; "" when it leaves. */
  readonly hover: (path: string) => void;
  /** Known values of text fields of the device or its product, by path. */
  readonly options: Readonly<Record<string, readonly string[]>>;
  /** Target of a search or a link, shown even if not basic: the name of a field, the number of a table's row; "" for none. */
  readonly sought: string;
  /** Paths of the port that the link uses; several: one of them. */
  readonly ports: readonly string[];
  /** Axes of the device's body. */
  readonly axes: Forms["axes"];
  /** Incremented when edits are discarded, so that typed texts are reset. */
  readonly epoch: number;
}

/** The server's problem at a path, or inside it. */
export function problemAt(sheet: FormContext, path: Path): FieldProblem | undefined {
  const own = joined(path);
  return sheet.problems.find((problem) => problem.path === own || problem.path.startsWith(`${own}.`));
}

/** For labels, hints and tests: the id of the control at a path. */
export const idOf = (sheet: FormContext, path: Path): string => `${sheet.id}-${joined(path)}`.replace(/[^\w-]+/g, "-");
