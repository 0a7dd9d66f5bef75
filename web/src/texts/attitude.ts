/** Texts of attitude, position and track. */
import type { Value } from "../wire/texts";

export const TEXT = {
  // alignment
  sensorTurned: (roll: Value, pitch: Value, yaw: Value) => `Sensor turned: roll ${roll}°, pitch ${pitch}°, yaw ${yaw}°`,
  sensorAxes: "Axes of the sensor in colour, aligned axes in grey",
  noRotation: "These numbers are no rotation: the squares of a quaternion add up to 1.",

  // panel
  nowFrom: (source: Value) => `now, ${source}`,
  payloadsUndefined: "Its payloads are not defined. See Raw payloads beside the plots.",
  noOrientation: "No orientation data",
  ubxAttitude: "With inertial sensors, a u-blox receiver sends roll, pitch and heading in NAV-ATT or HNR-ATT.",
  nmeaAttitude: "Its sentences have no whole orientation. Some have: $PSONCMS, $PINS1 and $VNYMR, for instance.",
  verified: "● verified",
  forwardLeftUp: "forward, left, up",
  forwardRightDown: "forward, right, down",
  frameHint: "Reference frame of attitude, body, plots and values",
  bodyAxes: (name: Value, axes: Value) => `${name}, body axes ${axes}`,
  nativeFrame: (axes: Value) => `${axes}: as sent by the device`,
  convertedFrame: (axes: Value, native: Value) => `${axes}: attitude, plots and values converted from ${native}`,
  artificialHorizon: "Artificial horizon",
  bodyLabel: "Sensor body with its x, y and z axes",
  body: "Body ",
  seenFromSw: "seen from SW",
  heading: "Heading",
  fromNorth: "from north",
  roll: "Roll",
  aboutX: "about x",
  pitch: "Pitch",
  bodyInFrame: (body: Value, frame: Value) => `${body} in ${frame}`,
  aboutY: (sign: Value) => `about y, ${sign}`,

  // projection
  noseUp: "+ nose up",
  noseDown: "+ nose down",

  // source
  fromQuaternion: "from quaternion",
  fromRotationMatrix: "from rotation matrix",
  fromEulerAngles: "from Euler angles",
  fromGroup: (group: Value) => `from ${group}`,
};
