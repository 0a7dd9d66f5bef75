/** Alarms that travel with a workspace: which go with it, and which a server lacks. */
import { expect, test } from "vitest";
import { answering } from "../../testing/recorded";
import type { AlarmDefinition, AlarmInfo, DeviceFilter } from "../../wire/routes";
import type { DeviceInfo } from "../../wire/types";
import { addAlarms, isFor, missingAlarms, travelling } from "./workspace";

const DEVICE = {
  ...{ id: "1", name: "MTi-630", product: "MTi-630-8A1G6" },
  ...{ serial_number: "0080A1", source: "sim:xbus", protocol: "xbus" },
} as DeviceInfo;
const alarm = (name: string, devices: Partial<DeviceFilter> = { family: "xbus" }): AlarmInfo => ({
  id: name.toLowerCase(),
  definition: {
    name,
    condition: { kind: "expression", expression: `Temperature > ${name.length} °C`, clear: "" },
    devices: { device: "", product: "", family: "", ...devices },
    level: "error",
    webhook: "https://example.org/…",
  } as unknown as AlarmDefinition,
  states: [],
});

test("the alarms of the devices go with a workspace, without webhooks", () => {
  const other = alarm("Other", { device: "0099" });
  const own = travelling([alarm("Hot"), other, alarm("All", {})], [DEVICE]);
  expect(own?.map(({ name, webhook }) => [name, webhook])).toEqual([
    ["Hot", ""],
    ["All", ""],
  ]);
  expect(travelling([other], [DEVICE])).toBeUndefined();
  expect([{ device: "sim:xbus" }, { product: "mti-630" }, { family: "isb" }].map((one) => isFor(one, DEVICE))).toEqual([
    true,
    true,
    false,
  ]);
});

test("those that the server has are not offered, however the keys of a file are ordered", () => {
  const file = JSON.parse(JSON.stringify(travelling([alarm("Hot"), alarm("Cold")], [DEVICE]))) as AlarmDefinition[];
  const [hot, cold] = file as [AlarmDefinition, AlarmDefinition];
  const turned = Object.fromEntries(Object.entries(hot.condition).reverse());
  const json = [{ ...hot, condition: turned }, cold, 7, { name: "no condition" }];
  expect(missingAlarms(json, [alarm("Hot")]).map(({ name }) => name)).toEqual(["Cold"]);
  expect(missingAlarms({ name: "no list" }, [])).toEqual([]);
  expect(missingAlarms(undefined, [])).toEqual([]);
});

test("each is added, and one that is refused does not stop the others", async () => {
  const [good, bad] = [alarm("Hot").definition, alarm("Odd").definition];
  const refusal = { kind: "bad-expression", message: "There is no signal Odd.", hint: "" };
  answering({
    [`POST /api/alarms ${JSON.stringify(good)}`]: {},
    [`POST /api/alarms ${JSON.stringify(bad)}`]: () => Response.json(refusal, { status: 422 }),
  });
  const { names, refused } = await addAlarms([bad, good]);
  expect(names).toEqual(["Hot"]);
  expect(refused.map(({ definition }) => definition.name)).toEqual(["Odd"]);
});
