// @vitest-environment happy-dom
/** When a dialog says that it was closed. */
import { cleanup, fireEvent, render, screen } from "@testing-library/preact";
import { beforeEach, expect, test, vi } from "vitest";
import { Dialog } from "./dialog";

const onClose = vi.fn();

beforeEach(() => {
  onClose.mockClear();
  render(
    <Dialog title="Open a file" onClose={onClose}>
      <input type="file" aria-label="File" />
    </Dialog>,
  );
});

const cancel = () => new Event("cancel", { bubbles: true, cancelable: true });

test("Esc closes it by the page's state, at once and once", () => {
  const dialog = screen.getByRole("dialog");
  const esc = cancel();
  fireEvent(dialog, esc);
  expect(onClose).toHaveBeenCalledTimes(1);
  expect(esc.defaultPrevented).toBe(true); // the browser would close it now, and say so later
  cleanup();
  expect(onClose).toHaveBeenCalledTimes(1);
});

test("a file chooser that is cancelled leaves it open", () => {
  fireEvent(screen.getByLabelText("File"), cancel());
  expect(onClose).not.toHaveBeenCalled();
});

test("a browser that closes it without asking is followed", () => {
  fireEvent(screen.getByRole("dialog"), new Event("close"));
  expect(onClose).toHaveBeenCalledTimes(1);
});
