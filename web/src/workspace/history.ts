/**
 * Undo and redo over the workspace of a view: states are compared a few times a second, and one that has stood still for a moment is
 * a step, whatever changed it. So a drag is one step, and a part that is added later is undone as well.
 */
import type { Workspace } from "./parts";

/** Steps kept. */
const MAX_STEPS = 100;

export class WorkspaceHistory {
  readonly #read: () => Workspace;
  readonly #apply: (workspace: Workspace) => void;
  #past: Workspace[] = [];
  #future: Workspace[] = [];
  #present: Workspace;
  #text: string;
  /** What was there when last looked, if it is not a step yet. */
  #pending = "";

  constructor(read: () => Workspace, apply: (workspace: Workspace) => void) {
    this.#read = read;
    this.#apply = apply;
    this.#present = read();
    this.#text = JSON.stringify(this.#present);
  }

  /** Compare; a change becomes a step once it is the same as last time. */
  look(): void {
    const now = this.#read();
    const text = JSON.stringify(now);
    if (text === this.#pending && text !== this.#text) this.#step(now, text);
    this.#pending = text;
  }

  get canUndo(): boolean {
    return this.#past.length > 0 || JSON.stringify(this.#read()) !== this.#text;
  }

  get canRedo(): boolean {
    return this.#future.length > 0;
  }

  /** False if there is nothing to undo. */
  undo(): boolean {
    this.mark();
    return this.#go(this.#past, this.#future);
  }

  redo(): boolean {
    this.mark();
    return this.#go(this.#future, this.#past);
  }

  /** The present state is where undoing ends: it was set by the page, not by a person. */
  restart(): void {
    this.#present = this.#read();
    this.#text = JSON.stringify(this.#present);
    [this.#past, this.#future] = [[], []];
  }

  /** What changed until now is a step. */
  mark(): void {
    const now = this.#read();
    const text = JSON.stringify(now);
    if (text !== this.#text) this.#step(now, text);
  }

  #step(now: Workspace, text: string): void {
    this.#past = [...this.#past, this.#present].slice(-MAX_STEPS);
    this.#future = [];
    [this.#present, this.#text] = [now, text];
  }

  #go(from: Workspace[], to: Workspace[]): boolean {
    const next = from.pop();
    if (next === undefined) return false;
    to.push(this.#present);
    this.#apply(next);
    this.#present = this.#read();
    this.#text = JSON.stringify(this.#present);
    return true;
  }
}
