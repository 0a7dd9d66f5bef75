// @vitest-environment happy-dom
/** Code that is fetched when it is first shown. */
import { act, fireEvent, render, screen } from "@testing-library/preact";
import { beforeEach, expect, test, vi } from "vitest";
import { useEffect, useRef } from "preact/hooks";
import { late } from "./late";
import { latePanel } from "./late-panel";

const Greeting = ({ name }: { readonly name: string }) => <p>Hello {name}</p>;

beforeEach(() => {
  vi.useFakeTimers();
});

test("what is shown meanwhile gives way to the component, which is fetched once", async () => {
  const load = vi.fn(async () => Greeting);
  const Late = late<{ name: string }>(load, <p>Loading</p>);
  const first = render(<Late name="IMU" />);
  expect(screen.getByText("Loading")).toBeTruthy();
  await act(async () => void (await vi.advanceTimersByTimeAsync(0)));
  expect(screen.getByText("Hello IMU")).toBeTruthy();
  first.unmount();
  render(<Late name="again" />);
  expect(screen.getByText("Hello again")).toBeTruthy(); // without a moment of nothing
  expect(load).toHaveBeenCalledTimes(1);
});

test("a server that is away is asked again, for as long as the component is shown", async () => {
  let isAway = true;
  const load = vi.fn(() => (isAway ? Promise.reject(new Error("away")) : Promise.resolve(Greeting)));
  const Late = late<{ name: string }>(load);
  const shown = render(<Late name="IMU" />);
  await act(async () => void (await vi.advanceTimersByTimeAsync(5000)));
  expect(load).toHaveBeenCalledTimes(3);
  isAway = false;
  await act(async () => void (await vi.advanceTimersByTimeAsync(2000)));
  expect(screen.getByText("Hello IMU")).toBeTruthy();
  shown.unmount();
  isAway = true;
  const Other = late<{ name: string }>(load);
  const other = render(<Other name="IMU" />);
  await act(async () => void (await vi.advanceTimersByTimeAsync(0)));
  other.unmount();
  const asked = load.mock.calls.length;
  await vi.advanceTimersByTimeAsync(60_000);
  expect(load).toHaveBeenCalledTimes(asked);
});

test("a panel that is shown while the server is away is there once it is back, unless it has gone", async () => {
  let isAway = true;
  const mount = vi.fn(() => ({ update: vi.fn(), dispose: vi.fn() }));
  const load = () => (isAway ? Promise.reject(new Error("away")) : Promise.resolve(mount));
  const [shown, gone] = [latePanel(load), latePanel(load)];
  await vi.advanceTimersByTimeAsync(1000);
  gone.dispose();
  isAway = false;
  await vi.advanceTimersByTimeAsync(2000);
  expect(mount).toHaveBeenCalledTimes(1);
  shown.update(5);
  expect(mount.mock.results[0]?.value.update).toHaveBeenCalledWith(5);
  shown.dispose();
  expect(mount.mock.results[0]?.value.dispose).toHaveBeenCalled();
});

test("keys typed before a part is there go to its field", async () => {
  const pressed = vi.fn();
  addEventListener("keydown", pressed);
  const found = vi.fn();
  const Field = () => {
    const field = useRef<HTMLInputElement>(null);
    useEffect(() => field.current?.focus(), []);
    return <input ref={field} type="search" onInput={({ currentTarget }) => found(currentTarget.value)} />;
  };
  const Late = late<object>(() => new Promise((resolve) => setTimeout(() => resolve(Field), 500)), null, true);
  render(<Late />);
  for (const key of ["r", "a", "x", "Backspace", " ", "z"]) fireEvent.keyDown(document.body, { key });
  expect(pressed).not.toHaveBeenCalled();
  await act(async () => void (await vi.advanceTimersByTimeAsync(2000))); // it is drawn, and has the focus
  await act(async () => void (await vi.advanceTimersByTimeAsync(0)));
  expect(found).toHaveBeenLastCalledWith("ra z");
  fireEvent.keyDown(document.body, { key: "a" });
  expect(pressed).toHaveBeenCalledTimes(1);
  removeEventListener("keydown", pressed);
});
