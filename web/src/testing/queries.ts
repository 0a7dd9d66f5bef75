/** For tests of pages: elements that must be there, what was asked, and a job as the server tells it. */
import { fireEvent, screen, waitFor } from "@testing-library/preact";
import { expect } from "vitest";
import type { Job } from "../wire/types";
import type { Asked } from "./recorded";

export function find(selector: string): HTMLElement {
  const found = document.querySelector(selector);
  if (!(found instanceof HTMLElement)) throw new Error(`no ${selector}`);
  return found;
}

export const press = (key: string, more: KeyboardEventInit = {}): void =>
  void fireEvent.keyDown(document.body, { key, ...more });

export const dialogNamed = (name: RegExp): Promise<HTMLElement> => screen.findByRole("dialog", { name });

export const noDialog = (): Promise<void> => waitFor(() => expect(screen.queryByRole("dialog")).toBeNull());

export const until = (selector: string): Promise<HTMLElement> => waitFor(() => find(selector));

/** Found by its words: to look for a role among hundreds of fields takes ten times as long. */
export function buttonOf(name: string, place: ParentNode = document): HTMLButtonElement {
  const found = [...place.querySelectorAll("button")].find(({ textContent }) => textContent?.trim() === name);
  if (found === undefined) throw new Error(`no button ${name}`);
  return found;
}

export const bodiesOf = ({ asked }: { readonly asked: readonly Asked[] }, path: string): readonly unknown[] =>
  asked.filter((one) => one.method === "POST" && one.path === path).map(({ body }) => body);

export const job = (id: number, more: Partial<Job> = {}): Job => ({
  ...{ id, device: "1", title: "Write Output configuration", state: "done", step: "", message: "", hint: "" },
  ...{ snapshot: "", values: {}, outcomes: [], started: 1, ended: 2 },
  ...more,
});
