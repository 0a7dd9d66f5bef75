import { expect, it } from "vitest";
import { messageParts } from "./message-parts";

/** The displayed text, with code in brackets. */
const shown = (message: string): string =>
  messageParts(message)
    .map(({ text, isCode }) => (isCode ? `[${text}]` : text))
    .join("");

it("distinguishes commands from text", () => {
  expect(shown("The port is taken.")).toBe("The port is taken.");
  expect(shown("Run `sudo usermod -aG dialout $USER`, then log out and in again.")).toBe(
    "Run [sudo usermod -aG dialout $USER], then log out and in again.",
  );
  expect(shown("`lsusb` or `dmesg | tail`")).toBe("[lsusb] or [dmesg | tail]");
  expect(messageParts("`a``b`")).toEqual([
    { text: "a", isCode: true },
    { text: "b", isCode: true },
  ]);
  expect(messageParts("")).toEqual([]);
});

it("ignores an unpaired backtick", () => {
  expect(shown("A ` in a name")).toBe("A ` in a name");
  expect(shown("`top` and a ` more")).toBe("[top] and a ` more");
  expect(shown("``")).toBe("``");
});
