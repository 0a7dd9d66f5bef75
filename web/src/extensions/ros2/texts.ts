/** Texts of the dialog of ROS 2 topics. */
import { count } from "../../texts/plural";
import type { Value } from "../../wire/texts";

export const TEXT = {
  ros: "ROS 2",
  topicsOf: (device: Value) => `ROS 2 topics of ${device}`,
  notPublished: "Devices are not published to ROS 2. Start the server with `--ros2`.",
  publishedAt: (router: Value, domain: Value) => `Router ${router}, domain ${domain}.`,
  connected: "Connected.",
  notConnected: "Not connected.",
  dropped: (samples: number) => `${count(samples, "sample")} not published in time.`,
  noTopics: "This device has no quantity that a topic could carry yet.",
  publish: (topic: Value) => `Publish ${topic}`,
  nobodySubscribes: "no subscriber",
  subscribers: (n: number) => count(n, "subscriber"),
  rate: (perSecond: Value) => `${perSecond} Hz`,
  messages: (n: number) => count(n, "message"),
  missing: "Not published",
};
