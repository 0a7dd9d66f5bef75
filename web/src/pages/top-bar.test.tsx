// @vitest-environment happy-dom
/** The frame of the pages: the bar, the tabs of a phone, the keys and their overlay, the link to the current view. */
import { fireEvent, screen, waitFor, within } from "@testing-library/preact";
import { expect, test, vi } from "vitest";
import { type Opened, openPage } from "../testing/live-page";
import { recorded } from "../testing/recorded";
import { keyGroups } from "../page/keys";
import { press } from "../testing/queries";

async function open(): Promise<Opened & { readonly bar: ReturnType<typeof within> }> {
  const page = await openPage(recorded("xbus"));
  await waitFor(() => expect(document.querySelector("[data-numeral]")).not.toBeNull());
  return { ...page, bar: within(screen.getByRole("banner")) };
}
const pressed = (button: HTMLElement): string | null => button.getAttribute("aria-pressed");

test("the time controls work and show the state", async () => {
  const { app, bar } = await open();
  const view = () => app.viewState.view.value;
  expect(pressed(bar.getByRole("button", { name: "Live" }))).toBe("true");
  fireEvent.click(bar.getByRole("button", { name: "Pause" }));
  await waitFor(() => expect(pressed(bar.getByRole("button", { name: "Pause" }))).toBe("true"));
  expect(view().live).toBe(false);
  fireEvent.change(bar.getByRole("combobox", { name: "Window length" }), { target: { value: "1" } });
  expect(view().span).toBe(1);
  fireEvent.click(bar.getByRole("button", { name: "Arrival time" }));
  await waitFor(() => expect(pressed(bar.getByRole("button", { name: "Arrival time" }))).toBe("true"));
  expect(view().timeBase).toBe("arrival");
  fireEvent.click(bar.getByRole("button", { name: /^Zoom in/ }));
  expect(view().span).toBeLessThan(1);
  fireEvent.click(bar.getByRole("button", { name: "Live" }));
  expect(view().live).toBe(true);
});

test("every control of the view has its key", async () => {
  const { app } = await open();
  const view = () => app.viewState.view.value;
  expect(view().live).toBe(true);
  press(" ", { code: "Space" });
  expect(view().live).toBe(false);
  press(" ", { code: "Space" });
  expect(view().live).toBe(true);
  press("ArrowLeft");
  expect(view().live).toBe(false);
  press("End");
  expect(view().live).toBe(true);
  const { span, timeBase } = view();
  press("+");
  expect(view().span).toBeLessThan(span);
  press("-");
  expect(view().span).toBeCloseTo(span);
  press("]");
  expect(view().span).toBeGreaterThan(span);
  press("[");
  expect(view().span).toBe(span);
  press("t");
  expect(view().timeBase).not.toBe(timeBase);
  press("t");
  expect(view().timeBase).toBe(timeBase);
});

test("a length set by zooming is in the list too", async () => {
  const { app, bar } = await open();
  press("+");
  const { span } = app.viewState.view.value;
  const list = (): HTMLElement => bar.getByRole("combobox", { name: "Window length" });
  await waitFor(() => expect(list()).toHaveProperty("value", String(span)));
});

test("the theme changes, and the button then offers the other", async () => {
  const { bar } = await open();
  const before = document.documentElement.dataset["theme"];
  fireEvent.click(bar.getByRole("button", { name: /^Use the (dark|light) theme$/ }));
  const after = document.documentElement.dataset["theme"];
  expect(after).not.toBe(before);
  await waitFor(() =>
    expect(bar.queryByRole("button", { name: `Use the ${after === "dark" ? "light" : "dark"} theme` })).not.toBeNull(),
  );
});

test("tabs and bar lead to the same pages and mark the current one", async () => {
  await open();
  const [inBar, tabs] = screen.getAllByRole("navigation", { name: "Pages" });
  if (inBar === undefined || tabs === undefined) throw new Error("no pages");
  const links = (list: HTMLElement): readonly (readonly (string | null | undefined)[])[] =>
    within(list)
      .getAllByRole("link")
      .map((link) => [link.textContent?.trim(), link.getAttribute("href"), link.getAttribute("aria-current")]);
  expect(links(tabs)).toEqual([
    ["Live", "#/", "page"],
    ["Configure", "#/configure", null],
    ["Recordings", "#/recordings", null],
  ]);
  expect(links(inBar)).toEqual(links(tabs));
});

test("two keys lead to another page, and the tabs follow", async () => {
  await open();
  press("g");
  press("r");
  expect(location.hash).toBe("#/recordings");
  dispatchEvent(new HashChangeEvent("hashchange"));
  const current = (): readonly string[] =>
    [...document.querySelectorAll(".tabs [aria-current=page]")].map(({ textContent }) => textContent ?? "");
  await waitFor(() => expect(current()).toEqual(["Recordings"]));
});

test.each(["the key", "the button"])("%s opens every key there is, and they rest meanwhile", async (way) => {
  const { app, bar } = await open();
  if (way === "the key") press("?");
  else fireEvent.click(bar.getByRole("button", { name: "Help: keys and guide" }));
  const help = await screen.findByRole("dialog", { name: "Keyboard shortcuts" });
  const shown = [...help.querySelectorAll("dt")].map((one) =>
    [...one.querySelectorAll("kbd")].map(({ textContent }) => textContent),
  );
  expect(shown).toEqual(keyGroups().flatMap(({ lines }) => lines.map(({ keys }) => keys)));
  expect(within(help).getAllByRole("link").length).toBe(2);
  press(" ", { code: "Space" });
  expect(app.viewState.isLive.value).toBe(true);
  fireEvent.click(within(help).getByRole("button", { name: "Close" }));
  await waitFor(() => expect(screen.queryByRole("dialog")).toBeNull());
  press(" ", { code: "Space" });
  expect(app.viewState.isLive.value).toBe(false);
});

test("the link to the current view is copied, or the failure reported", async () => {
  const { app, bar } = await open();
  const copied: string[] = [];
  const clipboard = vi
    .spyOn(navigator.clipboard, "writeText")
    .mockImplementation(async (text) => void copied.push(text));
  app.viewState.actions.setSpan(5);
  fireEvent.click(bar.getByRole("button", { name: "Copy link" }));
  await waitFor(() => expect(bar.getByText("Link copied")).toBeTruthy());
  const [link = ""] = copied;
  expect(link).toMatch(/#\/\?.*span=5/);
  expect(link).toContain(`device=${encodeURIComponent(app.device.value?.key ?? "")}`);
  clipboard.mockRejectedValue(new Error("not allowed"));
  document.execCommand = () => false;
  press("c");
  await waitFor(() => expect(bar.getByText(/blocks copying/)).toBeTruthy());
});
