/** Channels of the page. */
import { expect, it } from "vitest";
import { liveSource } from "../measure/sample-access";
import { wantedOf } from "../measure/figure-source";
import { channelInfo, columnInfo } from "../testing/fixtures";
import { Store } from "./store";

/** Regression: of a rate of turn in two messages only the newest was on the page, without a word. */
it("a quantity in two messages is two channels, each asked for by its own name", () => {
  const store = new Store();
  const of = (id: number, message: string) =>
    channelInfo({
      id,
      message,
      name: "RateOfTurn",
      kind: "vector",
      columns: ["x", "y", "z"].map((name) => columnInfo({ name })),
    });
  store.receive({ kind: "text", text: { op: "channels", channels: [of(1, "Imu6"), of(2, "Imu10")] } });
  const living = store.channels.value;
  expect(living.map(({ info }) => info.name)).toEqual(["RateOfTurn", "Imu10/RateOfTurn"]);
  const source = liveSource(store, "1");
  expect(living.map((channel) => wantedOf({ channel, column: 2 }, source)?.word)).toEqual([
    "Imu6/RateOfTurn.z",
    "Imu10/RateOfTurn.z",
  ]);
  store.receive({ kind: "text", text: { op: "channels", channels: [of(3, "Imu10")] } }); // in another form
  expect(store.channels.value.map(({ info }) => info.id)).toEqual([1, 3]);
});
