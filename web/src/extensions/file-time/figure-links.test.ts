// @vitest-environment happy-dom
/** Figures on loss and jitter become links to the clocks, however late they are added. */
import { fireEvent, waitFor } from "@testing-library/preact";
import { expect, test } from "vitest";
import { newApp } from "../../testing/live-page";
import { linkFigures } from "./figure-links";

test("figures, lines of gaps and losses of a recording lead to the clocks", async () => {
  const app = newApp();
  const stop = linkFigures(app, document.body);
  document.body.innerHTML = `<p><span data-about="time">Gaps</span></p>
    <button><span class="tag" data-about="time">3 gaps</span></button>
    <ol><li data-event="gap"><button>lost</button></li><li data-event="device"></li></ol>
    <b data-about="time" data-recording="a b">Lost</b>`;
  const [figure, inside] = document.querySelectorAll<HTMLElement>("span[data-about]");
  await waitFor(() => expect(figure?.getAttribute("role")).toBe("link"));
  expect(inside?.getAttribute("role")).toBeNull();
  const lines = [...document.querySelectorAll("li")].map((line) => line.textContent);
  expect(lines).toEqual(["lostTime", ""]);
  for (const pressed of [figure, inside, document.querySelector("li > [data-about]")]) {
    app.overlay.value = undefined;
    if (pressed) fireEvent.click(pressed);
    expect(app.overlay.value).toBe("file-time/clocks");
  }
  app.overlay.value = undefined;
  if (figure) fireEvent.keyDown(figure, { key: "Enter" });
  expect(app.overlay.value).toBe("file-time/clocks");
  const lost = document.querySelector("b");
  if (lost) fireEvent.click(lost);
  expect(location.hash).toBe("#/recordings/a%20b");
  stop();
  app.overlay.value = undefined;
  if (figure) fireEvent.click(figure);
  expect(app.overlay.value).toBeUndefined();
});
