import { expect, it } from "vitest";
import { WorkspaceHistory } from "./history";
import { FORMAT, VERSION, type Workspace } from "./parts";

function counter() {
  let value = 0;
  const read = (): Workspace => ({ format: FORMAT, version: VERSION, parts: { value } });
  const history = new WorkspaceHistory(read, ({ parts }) => void (value = parts["value"] as number));
  return {
    history,
    get value() {
      return value;
    },
    set: (next: number, looks = 2) => {
      value = next;
      for (let k = 0; k < looks; k += 1) history.look();
    },
  };
}

it("goes back and forth, step by step", () => {
  const one = counter();
  expect([one.history.canUndo, one.history.canRedo, one.history.undo()]).toEqual([false, false, false]);
  one.set(1);
  one.set(2);
  expect(one.history.undo() && one.value).toBe(1);
  expect(one.history.undo() && one.value).toBe(0);
  expect(one.history.undo()).toBe(false);
  expect(one.history.redo() && one.history.redo() && one.value).toBe(2);
  expect(one.history.redo()).toBe(false);
});

it("a change that goes on is one step, and one a moment ago is a step too", () => {
  const one = counter();
  for (let k = 1; k <= 20; k += 1) one.set(k, 1);
  expect(one.history.canUndo).toBe(true);
  one.history.undo();
  expect(one.value).toBe(0);
  one.history.redo();
  expect(one.value).toBe(20);
});

it("a new change after undoing takes the place of what was undone", () => {
  const one = counter();
  one.set(1);
  one.history.undo();
  one.set(5);
  expect(one.history.canRedo).toBe(false);
  one.history.undo();
  expect(one.value).toBe(0);
});

it("keeps a hundred steps, and none from before it was restarted", () => {
  const one = counter();
  for (let k = 1; k <= 150; k += 1) one.set(k);
  let steps = 0;
  while (one.history.undo()) steps += 1;
  expect([steps, one.value]).toEqual([100, 50]);
  one.set(7);
  one.history.restart();
  expect(one.history.canUndo).toBe(false);
});
