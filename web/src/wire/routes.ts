/** Routes of the HTTP API. Generated from its OpenAPI document by `python -m imuscope.server.generators.ts_types`; do not edit. */

import type { Attempt, DeviceHealth, DeviceInfo, DeviceJobs, ExportJob, Job, RecorderState, TrafficEntry } from "./types";
import type { Capabilities } from "./capability-types";
import type { ApplyRequest, ByteRange, CompareRequest, Corrections, Difference, FitRatesRequest, FitRatesResult, Forms, PreviewRequest, PreviewResult, RawRequest, ReadRequest, RunRequest, SaveRequest, SnapshotBody, SnapshotInfo } from "./form-types";
import type { EditRequest, ExportJobRequest, ExportSelection, ExportSizes, HeldBytes, MarkerInfo, MarkerRequest, OpeningState, PlayRequest, RecordedSettings, RecordingDetail, RecordingInfo, SaveMemoryRequest, SavedMemory, StartRequest } from "./recording-types";

/** Of `T`, the fields that the server has defaults for may be left out. */
export type Defaulted<T, K extends keyof T> = Omit<T, K> & { readonly [P in K]?: T[P] };

/** An acknowledgement. */
export interface AcknowledgeRequest {
  /** name of the person */
  readonly by: string;
  /** id of the device; empty for all */
  readonly device?: string;
}

/** A source to open. */
export interface AddDeviceRequest {
  /** name of the protocol; empty to detect it */
  readonly protocol?: string;
  /** key for Secure frames, hexadecimal; never returned */
  readonly key?: string;
  /** weakest protection mode accepted (default: secure with a key, else lite) */
  readonly min_mode?: "" | "lite" | "safety" | "secure";
  /** unit of timestamps, if the device does not report it (default: us, unless arrival times disagree) */
  readonly time_unit?: "" | "us" | "ms" | "ns" | "s";
  /** direction of quaternions, if the device does not report it (default: body to ENU) */
  readonly rotation?: "" | "enu_from_body" | "body_from_enu";
  /** description of vendor payload types, TOML */
  readonly schema?: string;
  /** without a key, show Secure frames, marked as unverified */
  readonly unverified?: boolean;
  /** as on the command line */
  readonly source: string;
}

/** Address at which the port of a device is shared. */
export interface AddShareRequest {
  /** `/run/imuscope/imu0`, `tcp://127.0.0.1:4001` or `udp://127.0.0.1:4002`; with `?mode=read` no client may write through it */
  readonly address: string;
}

/** Whether a definition is valid; a mistake in the expression has its place: characters begin ≤ i < end. */
export interface AlarmCheck {
  readonly valid: boolean;
  readonly message: string;
  readonly hint: string;
  readonly begin: number | null;
  readonly end: number | null;
  /** sentences about the condition, such as that a filter is causal */
  readonly notes: readonly string[];
  /** names of the present devices that it was checked with */
  readonly devices: readonly string[];
}

/** An alarm as set by a user. */
export interface AlarmDefinition {
  readonly name: string;
  readonly condition: ExpressionCondition | FlagCondition | HealthCondition;
  readonly devices?: DeviceFilter;
  readonly level?: "warning" | "error";
  /** the condition has to hold this long before the alarm is raised */
  readonly raise_s?: number;
  /** the signal has to be within the limit to clear this long */
  readonly clear_s?: number;
  /** without samples for this long: no data */
  readonly missing_s?: number;
  /** stays raised until it is acknowledged */
  readonly latched?: boolean;
  readonly enabled?: boolean;
  /** address (http or https) that each change is posted to as JSON; answers show its host only, and what they show keeps the stored one */
  readonly webhook?: string;
  /** starts a recording when it is raised */
  readonly recording?: RecordingAction | null;
}

/** An alarm with its states, one for each device that it is for at present. */
export interface AlarmInfo {
  readonly id: string;
  readonly definition: AlarmDefinition;
  readonly states: readonly AlarmState[];
}

/** Result of a preview: the times an alarm would have been raised. Values are in `unit`. */
export interface AlarmPreview {
  readonly times: number;
  readonly t0: number | null;
  readonly t1: number | null;
  readonly worst: number | null;
  readonly unit: string;
  readonly seconds: number;
  readonly intervals: readonly RaisedInterval[];
}

/** Definition to evaluate on stored samples, and their range. */
export interface AlarmPreviewRequest {
  readonly definition: AlarmDefinition;
  /** id of a live device, or of a recording */
  readonly source: string;
  /** device of the recording; empty for its first */
  readonly device?: string;
  /** of a live device: this long, as far as memory holds it */
  readonly seconds?: number;
}

/** State of an alarm of one device; values are in `unit`. */
export interface AlarmState {
  readonly device: string;
  readonly status: "missing" | "ok" | "pending" | "raised" | "acknowledged";
  readonly raised: boolean;
  readonly since: number | null;
  readonly value: number | null;
  readonly raised_value: number | null;
  readonly worst: number | null;
  readonly limit: number | null;
  readonly subject: string;
  readonly unit: string;
  readonly count: number;
  readonly acknowledged_by: string;
  readonly acknowledged: number | null;
  readonly problem: string;
  readonly signals: readonly string[];
  readonly intervals: readonly RaisedInterval[];
}

/** An analysis that can be requested. */
export interface AnalysisInfo {
  readonly name: string;
  readonly title: string;
  readonly words: string;
  readonly options: readonly OptionInfo[];
  /** texts for other programs that a request can have in place of JSON */
  readonly formats: readonly string[];
}

/** Signals, range and options of an analysis. */
export interface AnalysisRequest {
  /** id of a live device or of a recording */
  readonly source: string;
  /** `CHANNEL.COLUMN`, `CHANNEL` for all columns, or an expression; `DEVICE/…` if there are several */
  readonly signals: readonly string[];
  /** whose signals are meant where several devices have a channel of that name */
  readonly device?: string;
  /** unix seconds; null for the beginning */
  readonly t0?: number | null;
  /** unix seconds; null for the end */
  readonly t1?: number | null;
  readonly base?: "device" | "arrival";
  /** of the analysis; see `GET /api/analysis` */
  readonly options?: Readonly<Record<string, unknown>>;
  /** `json`; `arrow`: a table with one row per signal; or one of the analysis */
  readonly format?: string;
}

/** Name and type of a column in the result. */
export interface AnswerColumn {
  readonly name: string;
  /** times are ISO 8601 in UTC; integers beyond 2⁵³ are text */
  readonly kind: "integer" | "number" | "text" | "time" | "date" | "boolean" | "other";
}

/** A calibration, and whether the device shows what it needs. */
export interface AvailableCalibration {
  readonly kind: "gyroscope" | "magnetometer" | "accelerometer" | "mounting";
  readonly title: string;
  /** why it is not possible now; "" if it is */
  readonly problem: string;
  readonly hint: string;
}

/** Version and build of this imuscope. */
export interface Build {
  readonly name: "imuscope";
  readonly version: string;
  readonly wire: string;
  readonly python: string;
  readonly machine: string;
  readonly run: string;
  readonly protocols: readonly string[];
  readonly role: "view" | "control";
  /** whether this is a fleet server, which shows robots instead of devices */
  readonly fleet: boolean;
  /** names of extensions whose packages are not installed */
  readonly absent: readonly string[];
}

/** A number of the result. */
export interface CalibrationFigure {
  readonly name: string;
  readonly title: string;
  readonly value: number;
  /** standard uncertainty (1 σ), in `unit` */
  readonly uncertainty: number | null;
  readonly unit: string;
}

/** The reason why the samples do not determine the answer, and what helps. */
export interface CalibrationRefusal {
  readonly message: string;
  readonly hint: string;
}

/** A calibration of a sensor, complete or on its way. */
export interface CalibrationReport {
  readonly kind: "gyroscope" | "magnetometer" | "accelerometer" | "mounting";
  /** channel that it is of */
  readonly sensor: string;
  readonly unit: string;
  /** unix seconds of the first sample */
  readonly t0: number;
  /** from the first sample to the last */
  readonly seconds: number;
  readonly samples: number;
  /** 0 to 1; 1 when there is nothing left to do */
  readonly progress: number;
  /** what to do next, in a sentence */
  readonly advice: string;
  /** null once there is a result */
  readonly refusal: CalibrationRefusal | null;
  readonly correction: SensorCorrection | null;
  readonly figures: readonly CalibrationFigure[];
  readonly notes: readonly string[];
  readonly trace: ResidualTrace | null;
  readonly coverage: DirectionCoverage | null;
  readonly rest: RestProgress | null;
  readonly positions: SixPositions | null;
  readonly drive: DriveProgress | null;
}

/** A calibration of a stretch of samples. */
export interface CalibrationRequest {
  /** strength of the magnetic field there, in the unit of the signal; 0: unknown */
  readonly field?: number;
  /** m/s² there; 0: unknown (accelerometer) */
  readonly gravity?: number;
  /** the housing is square and rests on a level table (accelerometer) */
  readonly square?: boolean;
  /** where z of the vehicle points; null: as the device has it (mounting) */
  readonly vertical?: "up" | "down" | null;
  /** id of a live device or of a recording */
  readonly source: string;
  /** of a recording with several devices: which one */
  readonly device?: string;
  /** unix seconds; null for the beginning */
  readonly t0?: number | null;
  /** unix seconds; null for the end */
  readonly t1?: number | null;
  readonly base?: "device" | "arrival";
  /** `report`, or a text for other programs */
  readonly format?: "report" | "json" | "yaml" | "csv" | "c";
}

/** Calibrations of a live device, and the one under way. */
export interface CalibrationState {
  readonly available: readonly AvailableCalibration[];
  /** false before one is started, and once it has ended */
  readonly is_running: boolean;
  /** of the last one started; null if there is none */
  readonly report: CalibrationReport | null;
  /** how the device takes the result; null without a result, or if it takes none */
  readonly write: CalibrationWrite | null;
}

/** The setting of the device that takes the result; sent with `POST /api/devices/{device}/apply` like any change. */
export interface CalibrationWrite {
  readonly setting: string;
  readonly title: string;
  /** sentence on its effect */
  readonly note: string;
  /** of the setting; null while `problem` says why not */
  readonly values: Readonly<Record<string, unknown>> | null;
  readonly problem: string;
  readonly hint: string;
}

/** A value before and after; empty if it was not known. */
export interface ChangedValue {
  readonly title: string;
  readonly unit: string;
  readonly before: string;
  readonly after: string;
}

/** One channel as JSON, column by column; a bucket is two rows (min, max). */
export interface ChannelTable {
  readonly channel: string;
  readonly device: string;
  readonly frame: string;
  /** true: every row; false: summarised in buckets */
  readonly exact: boolean;
  /** for the columns that have a unit */
  readonly units: Readonly<Record<string, string>>;
  /** NaN is null; integers that JavaScript cannot represent are text */
  readonly columns: Readonly<Record<string, readonly unknown[]>>;
}

/** Course of a difference, in parts of its length: those without samples are absent. */
export interface ClockDifference {
  readonly times: readonly number[];
  readonly low: readonly number[];
  readonly high: readonly number[];
  readonly edges: readonly number[];
}

/** A step of a clock: "back", "ahead", "restart" or "wrap". */
export interface ClockStepFigures {
  readonly kind: string;
  readonly by_s: number;
  readonly row: number;
  readonly time: number;
}

/** Statistics of a range of one column; null without numbers, and for the mean of a rotating axis. */
export interface ColumnStatistics {
  readonly n: number;
  readonly mean: number | null;
  readonly sigma: number | null;
  readonly min: number | null;
  readonly max: number | null;
}

/** One side of a comparison: a range of a live device or of a recording. */
export interface ComparedSide {
  /** id of a live device or of a recording */
  readonly source: string;
  /** id of a device of the recording; needed if it has several */
  readonly device: string;
  /** unix seconds; null for the beginning */
  readonly t0: number | null;
  /** unix seconds; null for the end */
  readonly t1: number | null;
}

/** One signal of both sides, and B − A. */
export interface ComparedSignal {
  readonly signal: string;
  readonly signal_b: string;
  readonly unit: string;
  /** null for the attitude */
  readonly a: Outline | null;
  readonly b: Outline | null;
  /** at times of A; null without an overlap */
  readonly difference: Outline | null;
  /** `n`, `mean`, `sigma`, `rms`, `min`, `max`; 95 % of the differences lie between `low` and `high`; of an attitude also `mounting`, the angle of the mean rotation between the two, and `remaining`, the rms without it */
  readonly figures: Readonly<Record<string, number | null>>;
  readonly notes: readonly string[];
}

/** Both sides on one axis of time. */
export interface ComparisonAnswer {
  /** s to add to the times of B */
  readonly offset: number;
  /** half of its 95 % interval, s; null unless correlated */
  readonly uncertainty: number | null;
  /** of the overlapping parts, -1 to 1 */
  readonly correlation: number | null;
  /** of the correlated parts, s */
  readonly overlap: number | null;
  readonly notes: readonly string[];
  /** an attitude follows its columns, as the angle between both, ° */
  readonly signals: readonly ComparedSignal[];
}

/** A request for a comparison of B with A, the reference. */
export interface ComparisonRequest {
  readonly a: ComparedSide;
  readonly b: ComparedSide;
  /** of A, as for an analysis */
  readonly signals: readonly string[];
  /** of B, in the same order; empty: as those of A */
  readonly signals_b?: readonly string[];
  /** `offset`: as given, 0 is by the clock; `start`: the first samples coincide; `correlation`: where the signals fit best */
  readonly align?: "offset" | "start" | "correlation";
  /** s to add to the times of B */
  readonly offset?: number;
  /** `correlation` searches as far as this on both sides of `offset`, s; null: all */
  readonly search?: number | null;
  /** signals to correlate, of both; empty: those compared */
  readonly align_by?: readonly string[];
  readonly base?: "device" | "arrival";
  /** points of each outline at most */
  readonly columns?: number;
}

/** A computed signal of a live device. */
export interface ComputedSignal {
  /** of its channel */
  readonly name: string;
  readonly expression: string;
  /** "" while it is not being computed */
  readonly unit: string;
  /** why it is not being computed; "" if it is */
  readonly message: string;
  readonly hint: string;
}

/** A stream to forward. */
export interface CorrectionsRequest {
  /** RTCM 3 from ntrip://user:password@host:2101/MOUNT, tcp://host:port, or a file: of the library, or of a folder that source_folders names */
  readonly source: string;
}

/** Decode options of a source. */
export interface DecodeOptionsBody {
  /** name of the protocol; empty to detect it */
  readonly protocol?: string;
  /** key for Secure frames, hexadecimal; never returned */
  readonly key?: string;
  /** weakest protection mode accepted (default: secure with a key, else lite) */
  readonly min_mode?: "" | "lite" | "safety" | "secure";
  /** unit of timestamps, if the device does not report it (default: us, unless arrival times disagree) */
  readonly time_unit?: "" | "us" | "ms" | "ns" | "s";
  /** direction of quaternions, if the device does not report it (default: body to ENU) */
  readonly rotation?: "" | "enu_from_body" | "body_from_enu";
  /** description of vendor payload types, TOML */
  readonly schema?: string;
  /** without a key, show Secure frames, marked as unverified */
  readonly unverified?: boolean;
}

/** Choice of the workspace in which devices of a family open. */
export interface DefaultWorkspaceRequest {
  /** null: the page's own layout */
  readonly name: string | null;
}

/** The devices that an alarm is for; empty fields fit any device. */
export interface DeviceFilter {
  /** serial number, source or name of one device */
  readonly device: string;
  /** beginning of the product's name */
  readonly product: string;
  /** name of the protocol */
  readonly family: string;
}

/** A device that differs, or may differ, and would not be written to. */
export interface DeviceLeftOut {
  readonly robot: string;
  /** id */
  readonly device: string;
  readonly name: string;
  readonly why: string;
}

/** A device against the profile of its group. */
export interface DeviceSettingsCheck {
  /** id */
  readonly device: string;
  readonly name: string;
  readonly state: "unknown" | "as-profile" | "drifted";
  /** why it is unknown; empty otherwise */
  readonly why: string;
  /** clock of the robot, unix s: when its settings were read; null if unknown */
  readonly read: number | null;
  readonly profile: ProfileOrigin | null;
  /** number of fields that are as in the profile */
  readonly same: number;
  readonly rows: readonly SettingDifference[];
  /** setting → why it could not be compared */
  readonly missing: Readonly<Record<string, string>>;
}

/** Directions seen, as cells of equal area on a sphere around the sensor. */
export interface DirectionCoverage {
  /** number of cells in each ring of a half */
  readonly rings: readonly number[];
  /** by cell */
  readonly seen: readonly boolean[];
  /** of the cells, 0 to 1 */
  readonly share: number;
  /** share from which a result is given */
  readonly needed: number;
  /** share at which the calibration is complete */
  readonly goal: number;
  /** axes without samples near them: +x, −z … */
  readonly missing: readonly string[];
  /** direction of the newest sample, unit vector; empty if there is none */
  readonly now: readonly number[];
}

/** The straight drive of a mounting calibration. */
export interface DriveProgress {
  /** rest before the drive, s */
  readonly rest_s: number;
  readonly rest_needed_s: number;
  /** m/s, summed over acceleration and braking */
  readonly speed_change: number;
  readonly speed_needed: number;
  /** ° of heading between the beginning and the end of the drive */
  readonly turn: number;
  readonly turn_allowed: number;
}

/** Curves that share one plot and its axes. */
export interface EvidencePlot {
  readonly title: string;
  readonly unit: string;
  readonly series: readonly EvidenceSeries[];
  readonly low: number | null;
  readonly high: number | null;
  readonly log: boolean;
}

/** Choice of what the file shows; everything may be left out. */
export interface EvidenceRequest {
  readonly t0?: number | null;
  readonly t1?: number | null;
  readonly base?: "device" | "arrival";
  readonly plots?: readonly EvidencePlot[] | null;
  readonly cursor_a?: number | null;
  readonly cursor_b?: number | null;
  readonly with_position?: boolean;
}

/** One curve: a signal as `POST /api/analysis/{name}` names it, shown as `factor` · value + `offset`. */
export interface EvidenceSeries {
  readonly signal: string;
  readonly part: number;
  readonly factor: number;
  readonly offset: number;
  readonly label: string;
  readonly colour: "axis-x" | "axis-y" | "axis-z" | "axis-n" | "";
  readonly dash: readonly number[];
  readonly decimals: number;
  readonly period: number;
}

/** A condition on signals: `norm(Acceleration) > 3 g`. */
export interface ExpressionCondition {
  readonly kind: "expression";
  /** a comparison, or several with and, or, not */
  readonly expression: string;
  /** limit to clear, for example `2.5 g`; empty: the limit itself */
  readonly clear: string;
}

/** A function that expressions may use. */
export interface ExpressionFunction {
  readonly name: string;
  /** as typed, with its arguments */
  readonly form: string;
  readonly doc: string;
}

/** Words that expressions may consist of, besides signals and numbers. */
export interface ExpressionWords {
  readonly functions: readonly ExpressionFunction[];
  readonly units: readonly string[];
}

/** A recording of the store in the library of this server. */
export interface FetchedRecording {
  /** its id in the library */
  readonly id: string;
  /** whether it was fetched now */
  readonly is_new: boolean;
}

/** A clock of one message of a device, or of a table. */
export interface FileClock {
  readonly name: string;
  readonly unit: string;
  readonly epoch: string;
  readonly is_axis: boolean;
  readonly why: string;
  readonly samples: number;
  readonly resolution_s: number | null;
  readonly rate_hz: number | null;
  readonly drift_ppm: number | null;
  readonly drift_error_ppm: number | null;
  readonly jitter_s: number | null;
  readonly repeats: number;
  readonly gaps: number;
  readonly bursts: number;
  readonly burst_samples: number;
  readonly steps: readonly ClockStepFigures[];
  readonly steps_in_all: number;
  readonly use: string;
  readonly difference: ClockDifference | null;
}

/** Choices on how a recording is read; "" and 0 where the file decides. */
export interface FileReadingBody {
  /** heading or number of the column of times; "none" counts the rows */
  readonly time_column?: string;
  /** of the times */
  readonly unit?: "" | "s" | "ms" | "us" | "ns";
  /** of dates like 01/02/2026 */
  readonly date_order?: "" | "dmy" | "mdy";
  /** samples per second; 0 if it is not needed */
  readonly rate?: number;
  /** heading or number of a column → its name with the unit; "" leaves it out */
  readonly columns?: Readonly<Record<string, string>>;
  /** time axis of devices and messages */
  readonly clock?: "" | "device" | "arrival";
}

/** Time of a recording: its clocks, and which of them is the time axis. */
export interface FileTime {
  readonly start: number | null;
  readonly end: number | null;
  readonly sentences: readonly string[];
  readonly sure: string;
  readonly messages: readonly MessageClocks[];
  readonly reading: FileReadingBody;
  readonly is_chosen: boolean;
  readonly is_table: boolean;
}

/** A flag or a bit group of a status word. */
export interface FlagCondition {
  readonly kind: "flag";
  /** name of the channel: `StatusWord` */
  readonly signal: string;
  /** name of the flag */
  readonly flag: string;
  /** raised while the flag is set; false: while it is clear */
  readonly is_set: boolean;
}

/** Acknowledgement of a fleet alarm by an operator. */
export interface FleetAcknowledgement {
  /** as in RobotAlarm */
  readonly condition: string;
  /** name of the person */
  readonly by: string;
}

/** An event of a robot, or of a device of it. */
export interface FleetEvent {
  /** rises with each event that the fleet server receives */
  readonly id: number;
  readonly robot: string;
  /** clock of the robot, unix s */
  readonly time: number;
  /** link, device, alarm, marker, command, clock, or another one that is not info */
  readonly kind: string;
  /** info, warning or error */
  readonly level: string;
  readonly text: string;
  /** id of the robot's device; empty if it is of none */
  readonly device: string;
}

/** Robots of a fleet: all, or those that changed after a revision. */
export interface FleetRobots {
  /** to be sent as `after` with the next request */
  readonly revision: number;
  /** clock of the fleet server, unix s */
  readonly time: number;
  /** all robots are listed: any other that the client knows has gone */
  readonly complete: boolean;
  /** names of robots that were removed since */
  readonly gone: readonly string[];
  readonly robots: readonly RobotSummary[];
}

/** A figure of a link beyond a limit. */
export interface HealthCondition {
  readonly kind: "health";
  /** `rate` below a limit in Hz, `loss` above a limit in % of the samples of 10 s, `silence` longer than a limit in s, `clock` uncertainty above a limit in ms, `link` lost */
  readonly figure: "rate" | "loss" | "silence" | "clock" | "link";
  /** not used for `link` */
  readonly limit: number;
  /** limit to clear; null: the limit itself */
  readonly clear: number | null;
}

/** A range of seconds of one device: a list holds one value a second from `first` on; None: unknown. */
export interface HealthHistory {
  readonly first: number;
  readonly before: number;
  readonly bytes: readonly number[];
  readonly jitter_ms: readonly (number | null)[];
  readonly drift_ppm: readonly (number | null)[];
  readonly uncertainty_ms: readonly (number | null)[];
  readonly messages: Readonly<Record<string, readonly number[]>>;
  readonly counted: Readonly<Record<string, number>>;
}

/** The server answers. */
export interface HealthStatus {
  readonly status: "ok";
  readonly devices: number;
  readonly browsers: number;
}

/** An installed extension. */
export interface InstalledExtension {
  readonly name: string;
  readonly title: string;
  readonly package: string;
  readonly module: string;
}

/** Time of a live device, over its bytes in memory. */
export interface LiveTime {
  readonly start: number;
  readonly end: number;
  readonly sentences: readonly string[];
  readonly messages: readonly MessageClocks[];
}

/** Whether a map is configured, and its attribution. */
export interface MapInfo {
  readonly tiles: boolean;
  readonly attribution: string;
}

/** Clocks of one message. */
export interface MessageClocks {
  readonly device: string;
  readonly message: string;
  readonly clocks: readonly FileClock[];
}

/** A topic that a device cannot have. */
export interface MissingTopic {
  readonly device: string;
  readonly topic: string;
  readonly reason: string;
}

/** A name of one's own for a device. */
export interface NameDeviceRequest {
  /** empty: none any more */
  readonly name: string;
}

/** An option of an analysis: a number, or one of `choices`. */
export interface OptionInfo {
  readonly name: string;
  readonly default: number | string;
  readonly low: number;
  readonly high: number;
  readonly unit: string;
  readonly doc: string;
  /** words of which a request gives one; empty if the option is a number */
  readonly choices: readonly string[];
}

/** A signal for a plot: least and greatest value of each part of the time; null in gaps. */
export interface Outline {
  /** unix seconds, of the own clock of each side */
  readonly time: readonly (number | null)[];
  readonly low: readonly (number | null)[];
  readonly high: readonly (number | null)[];
}

/** A frame, a rejected one, bytes between frames, or bytes sent to the device. */
export interface PacketInfo {
  readonly kind: "frame" | "reject" | "foreign" | "sent";
  readonly arrival: number;
  readonly gap_ms: number | null;
  readonly rank: number;
  readonly size: number;
  readonly hex: string;
  readonly name: string;
  readonly title: string;
  readonly protocol: string;
  readonly verdict: string;
  readonly reason: string;
  readonly doc: string;
  readonly source: string;
  readonly spans: readonly ByteRange[];
  readonly fields: Readonly<Record<string, unknown>>;
  readonly flags: Readonly<Record<string, unknown>>;
}

/** A frame and its neighbours. */
export interface PacketView {
  readonly device: string;
  readonly protocol: string;
  readonly at: number;
  readonly time: number | null;
  readonly packets: readonly PacketInfo[];
}

/** Pairs of two signals; times are seconds after `t0`. */
export interface PairsInfo {
  /** number of pairs, also of those left out */
  readonly n: number;
  /** unix seconds of the first pair */
  readonly t0: number;
  readonly time: readonly number[];
  readonly x: readonly number[];
  readonly y: readonly number[];
  /** indices of pairs that no line may come to: after a gap, or a wrapped angle */
  readonly starts: readonly number[];
  readonly x_unit: string;
  readonly y_unit: string;
  /** the signal whose times these are; empty if both signals have the same times */
  readonly leader: string;
}

/** A request for pairs of two signals. */
export interface PairsRequest {
  /** id of a live device or of a recording */
  readonly source: string;
  readonly x: PairsSignal;
  readonly y: PairsSignal;
  /** unix seconds; null for the beginning */
  readonly t0?: number | null;
  /** unix seconds; null for the end */
  readonly t1?: number | null;
  readonly base?: "device" | "arrival";
  /** value of the signal with fewer samples at the times of the other */
  readonly pairing?: "interpolated" | "nearest";
  /** with more pairs than this, of each interval the first, the last and the extremes of x and y */
  readonly points?: number;
}

/** One axis of a plot of pairs. */
export interface PairsSignal {
  /** `CHANNEL.COLUMN` or an expression; `DEVICE/…` if there are several */
  readonly signal: string;
  /** which one, if that names several, from 0 */
  readonly part: number;
}

/** A device that a rollout would write to. */
export interface PlannedDevice {
  readonly robot: string;
  /** id */
  readonly device: string;
  readonly name: string;
  /** place in `changes` */
  readonly change: number;
}

/** One serial port. */
export interface PortInfo {
  readonly device: string;
  readonly description: string;
  readonly busy: string;
  readonly denied: string;
  readonly attempts: readonly Attempt[];
}

/** A shared address, its state, and its connected clients. */
export interface PortShare {
  readonly name: string;
  readonly kind: "pty" | "tcp" | "udp";
  readonly read_only: boolean;
  readonly clients: readonly ShareClient[];
}

/** SQL that is offered by name, with its description. */
export interface PreparedQuestionInfo {
  readonly name: string;
  readonly title: string;
  readonly sql: string;
}

/** A column of a table. */
export interface PreviewColumn {
  readonly number: number;
  readonly heading: string;
  readonly name: string;
  readonly unit: string;
  readonly group: string;
  readonly axis: string;
  readonly role: "time" | "clock" | "arrival" | "value" | "left out";
}

/** The shape of every error. */
export interface ProblemBody {
  /** one word for programs */
  readonly kind: string;
  /** one sentence for the user */
  readonly message: string;
  /** what to do next; may be empty */
  readonly hint: string;
}

/** Robot, device and operator from which the profile was taken. */
export interface ProfileOrigin {
  readonly robot: string;
  /** displayed name */
  readonly device: string;
  /** name of the person */
  readonly by: string;
  /** clock of the fleet server, unix s */
  readonly time: number;
}

/** A device, and the name of the operator. */
export interface ProfileRequest {
  /** id of the robot's device */
  readonly device: string;
  /** name of the person */
  readonly by: string;
}

/** An answer as JSON. A value that is missing or not finite is null. */
export interface QueryAnswer {
  readonly columns: readonly AnswerColumn[];
  readonly rows: readonly (readonly unknown[])[];
  /** whether there are more rows than these */
  readonly more: boolean;
  /** time that the question took, without waiting */
  readonly seconds: number;
}

/** A question: SQL, or the name of a prepared question. */
export interface QueryBody {
  /** one statement that reads, as DuckDB has it */
  readonly sql?: string;
  /** name of a prepared question, in place of `sql` */
  readonly question?: string;
  /** `arrow`: an IPC stream; all but `json` have all rows */
  readonly format?: "json" | "arrow" | "csv" | "parquet";
  /** most rows of an answer as JSON */
  readonly rows?: number;
  /** longest time, s; at most that of the server */
  readonly timeout_s?: number | null;
  /** most memory, MB; at most that of the server */
  readonly memory_mb?: number | null;
  /** a name by which `GET /api/query` lists this question */
  readonly id?: string;
}

/** The store, and the questions about it. */
export interface QueryState {
  /** URL or folder; empty if this server has no store */
  readonly store: string;
  /** number of questions that are answered at once */
  readonly at_once: number;
  readonly running: number;
  readonly waiting: number;
  /** longest time of a question, s */
  readonly timeout_s: number;
  /** most memory of a question, MB */
  readonly memory_mb: number;
  /** those of this client */
  readonly questions: readonly QuestionState[];
}

/** Names that a question may use. */
export interface QueryWords {
  readonly tables: readonly TableInfo[];
  readonly signals: readonly SignalWord[];
  readonly functions: readonly SqlFunction[];
}

/** A question of this client that waits or runs. */
export interface QuestionState {
  readonly id: string;
  readonly is_running: boolean;
  /** number of waiting questions that are answered before this one */
  readonly before: number;
}

/** An interval in which an alarm was raised, unix s; `t1` None: until now. */
export interface RaisedInterval {
  readonly t0: number;
  readonly t1: number | null;
  readonly worst: number | null;
}

/** Choices on how a recording is read, and the open question of its table. */
export interface ReadingState {
  readonly reading: FileReadingBody;
  readonly is_chosen: boolean;
  readonly is_table: boolean;
  readonly about: "" | "time" | "unit" | "order" | "rate";
  readonly problem: string;
}

/** Device whose sequence may restart. */
export interface RearmDeviceRequest {
  /** the id of the device in the stream; empty: every device of the link */
  readonly sender?: string;
}

/** A recording of what led to an alarm and of what followed. */
export interface RecordingAction {
  /** begins this long before the limit was crossed, from memory */
  readonly before_s: number;
  /** ends this long after the condition has ended */
  readonly after_s: number;
  /** ends this long after the alarm was raised in any case */
  readonly longest_s: number;
  /** most recordings within an hour */
  readonly per_hour: number;
  /** records all devices, not only the one of the alarm */
  readonly every_device: boolean;
}

/** Upload of a recording. */
export interface RecordingUpload {
  readonly id: string;
  readonly state: "waiting" | "uploading" | "stored" | "refused";
  readonly reason: string;
  readonly progress: number;
  readonly recording: string;
  readonly object: string;
  readonly checksum: string;
  readonly stored_at: number | null;
}

/** A magnitude that does not depend on attitude, before and after the correction. */
export interface ResidualTrace {
  readonly title: string;
  readonly unit: string;
  /** the value without error */
  readonly target: number;
  readonly before: readonly number[];
  readonly after: readonly number[];
}

/** One of the six positions: the axis that points up, and how long it rested there. */
export interface RestPosition {
  /** +x, −x, +y … */
  readonly up: string;
  readonly seconds: number;
  readonly is_done: boolean;
}

/** Stillness of the sensor, and its duration. */
export interface RestProgress {
  readonly is_still: boolean;
  /** of the last second, as a share of what still counts as rest; above 1 it moves */
  readonly motion: number;
  /** the longest rest so far */
  readonly seconds: number;
  /** seconds from which a result is given */
  readonly needed: number;
  /** seconds at which the calibration is complete */
  readonly goal: number;
}

/** An alarm of a robot that is raised. */
export interface RobotAlarm {
  readonly name: string;
  /** info, warning or error, or another one of a later version */
  readonly level: string;
  /** raised, acknowledged, missing (raised, and at present without data), or another */
  readonly state: string;
  /** id of the robot's device; empty if it is for none */
  readonly device: string;
  /** of the fleet server's own: lost, loss, settings or disk; else empty */
  readonly condition: string;
  /** of the fleet server's own: name of the person */
  readonly acknowledged_by: string;
}

/** Identity, rate and comparison with the profile of one device. */
export interface RobotDevice {
  /** as on the robot's own page */
  readonly id: string;
  readonly name: string;
  /** as DeviceStatus, or another one of a later version */
  readonly status: string;
  readonly product: string;
  readonly serial_number: string;
  readonly firmware: string;
  /** empty while it is unknown */
  readonly protocol: string;
  /** samples/s of the fastest message, within 1 % */
  readonly rate: number;
  /** samples/s that it is configured for; null if unknown */
  readonly expected_rate: number | null;
  /** share of samples lost in the last minute, 0 … 1; null if unknown */
  readonly loss: number | null;
  /** samples lost since the robot's server was started */
  readonly lost: number;
  /** fix of its receiver of satellites, in words; empty if it has none */
  readonly fix: string;
  /** °C */
  readonly temperature: number | null;
  /** its clock against that of its host */
  readonly clock_ppm: number | null;
  /** ± of the mapping from device time to host time */
  readonly clock_uncertainty_ms: number | null;
  /** digest of its settings, as last read; empty while they are unknown */
  readonly settings: string;
  /** clock of the robot, unix s: when they were read */
  readonly settings_read: number | null;
  /** what a later version reports, by name */
  readonly more: Readonly<Record<string, string>>;
}

/** Row of the fleet page: link, recorder, disk, alarms and devices of one robot. */
export interface RobotSummary {
  readonly name: string;
  /** empty if it is in none */
  readonly group: string;
  readonly state: "live" | "lost";
  /** unix s of the fleet server: when it came, or was lost */
  readonly since: number;
  /** round trip between robot and fleet server; null if unknown */
  readonly latency_ms: number | null;
  /** of its imuscope */
  readonly version: string;
  /** of its own page; empty if it gave none */
  readonly address: string;
  /** what the fleet server may do with its pages at /robots/NAME/: off, view, control, or another word */
  readonly pages: string;
  readonly recording: boolean;
  /** of its data folder; null if unknown */
  readonly disk_free_bytes: number | null;
  /** compared with the profile of its group */
  readonly settings: "unknown" | "as-profile" | "drifted";
  /** number of settings that differ from the profile */
  readonly drifted: number;
  /** those that are raised */
  readonly alarms: readonly RobotAlarm[];
  readonly devices: readonly RobotDevice[];
  /** other live robots that have this name, shown as `NAME (2)` and so on */
  readonly same_name: number;
  /** what a later version reports, by name */
  readonly more: Readonly<Record<string, string>>;
}

/** Application of a profile to the devices of a group, in waves. */
export interface Rollout {
  readonly id: number;
  readonly group: string;
  readonly product: string;
  readonly protocol: string;
  readonly profile: ProfileOrigin;
  /** name of the person who started it */
  readonly by: string;
  readonly state: "running" | "done" | "failed" | "stopped" | "interrupted";
  /** why it ended, in words */
  readonly words: string;
  /** name of the person who stopped it */
  readonly stopped_by: string;
  /** clock of the fleet server, unix s */
  readonly started: number;
  readonly ended: number | null;
  /** time for which a device has to deliver before it is confirmed, s */
  readonly watch_s: number;
  /** number of devices in each wave */
  readonly waves: readonly number[];
  /** the present one, from 1 */
  readonly wave: number;
  readonly devices: readonly RolloutDevice[];
  readonly changes: readonly RolloutChanges[];
}

/** A setting that the rollout changes, with the old and the new value. */
export interface RolloutChange {
  /** as on the page Configure */
  readonly title: string;
  /** value of the device as text; empty if it has none */
  readonly now: string;
  /** value of the profile as text; empty if it has none */
  readonly profile: string;
}

/** Settings that are changed, of all devices that have the same. */
export interface RolloutChanges {
  readonly rows: readonly RolloutChange[];
  /** consequences, one sentence each */
  readonly risks: readonly string[];
}

/** Progress of a rollout on one device: its wave, state and last message. */
export interface RolloutDevice {
  readonly robot: string;
  /** id */
  readonly device: string;
  readonly name: string;
  /** from 1 */
  readonly wave: number;
  readonly state: "waiting" | "applying" | "watching" | "confirming" | "done" | "failed" | "unknown" | "left" | "not-started";
  /** what happened, in words */
  readonly words: string;
  /** clock of the fleet server, unix s: since when it is in this state */
  readonly time: number | null;
  /** place in `changes` */
  readonly change: number;
}

/** A rollout without its devices. */
export interface RolloutHead {
  readonly id: number;
  readonly group: string;
  readonly product: string;
  readonly protocol: string;
  readonly profile: ProfileOrigin;
  /** name of the person who started it */
  readonly by: string;
  readonly state: "running" | "done" | "failed" | "stopped" | "interrupted";
  /** why it ended, in words */
  readonly words: string;
  /** name of the person who stopped it */
  readonly stopped_by: string;
  /** clock of the fleet server, unix s */
  readonly started: number;
  readonly ended: number | null;
  /** time for which a device has to deliver before it is confirmed, s */
  readonly watch_s: number;
  /** number of devices in each wave */
  readonly waves: readonly number[];
  /** the present one, from 1 */
  readonly wave: number;
}

/** Plan of a rollout, as of now. */
export interface RolloutPlan {
  /** to be sent with the start; another one as soon as something else would be done */
  readonly id: string;
  readonly group: string;
  readonly product: string;
  readonly profile: ProfileOrigin;
  /** in the order in which they would be written to */
  readonly devices: readonly PlannedDevice[];
  readonly changes: readonly RolloutChanges[];
  readonly left_out: readonly DeviceLeftOut[];
  /** number of devices that have the settings of the profile already */
  readonly same: number;
  /** number of devices in each wave */
  readonly waves: readonly number[];
  /** id of the rollout of this profile that is under way */
  readonly running: number | null;
}

/** The plan that a user has seen, and how it is to be carried out. */
export interface RolloutRequest {
  /** id of a device of the robot, whose profile it is */
  readonly device: string;
  /** id of the plan */
  readonly plan: string;
  /** name of the person */
  readonly by: string;
  /** sizes of waves, or percentages of the rest, separated by commas; the last one is repeated */
  readonly waves?: string;
  /** time for which a device has to deliver before it is confirmed, s */
  readonly watch_s?: number;
}

/** A user who stops a rollout. */
export interface RolloutStopRequest {
  /** name of the person */
  readonly by: string;
}

/** Connection to the router, and the published topics. */
export interface RosState {
  /** whether the server was started with --ros2 */
  readonly enabled: boolean;
  /** address of the Zenoh router */
  readonly router: string;
  readonly domain: number;
  readonly namespace: string;
  /** whether the router is reached */
  readonly connected: boolean;
  /** other sessions that are reached directly */
  readonly peers: number;
  /** samples that the publisher did not get in time */
  readonly dropped: number;
  /** why the router is not reached; empty if it is */
  readonly problem: string;
  readonly hint: string;
  readonly topics: readonly RosTopic[];
  readonly missing: readonly MissingTopic[];
}

/** Published topic of a device: its type, rate, subscribers and switch. */
export interface RosTopic {
  /** identifies the topic; devices share the names /diagnostics and /tf */
  readonly key: string;
  readonly device: string;
  /** with its namespace: `/imu0` */
  readonly node: string;
  /** with its namespace: `/imu0/imu/data` */
  readonly name: string;
  /** `sensor_msgs/msg/Imu` */
  readonly type: string;
  /** of the type: `RIHS01_…`; empty while the topic is switched off */
  readonly hash: string;
  readonly enabled: boolean;
  readonly subscribers: number;
  /** messages/s; 0 without subscribers */
  readonly rate: number;
  /** since the topic was announced */
  readonly messages: number;
  /** of these messages */
  readonly bytes: number;
  /** a subscriber that expects another type; empty if there is none */
  readonly problem: string;
}

/** Content to store under the name of a workspace. */
export interface SaveWorkspaceRequest {
  /** format, version and parts, as the page exports it */
  readonly workspace: Readonly<Record<string, unknown>>;
}

/** Choice of serial ports to scan for devices. */
export interface ScanPortsRequest {
  /** paths; null for every port that is present */
  readonly ports?: readonly string[] | null;
}

/** Path of a 3D scene that was opened for this client. */
export interface SceneAddress {
  /** path on this server */
  readonly address: string;
}

/** The result: corrected = matrix · (measured − bias), in the axes of the sensor. */
export interface SensorCorrection {
  readonly unit: string;
  /** x, y, z, in `unit` */
  readonly bias: readonly number[];
  /** standard uncertainties (1 σ), in `unit` */
  readonly bias_uncertainty: readonly number[];
  /** three rows */
  readonly matrix: readonly (readonly number[])[];
  /** the largest standard uncertainty (1 σ) of its elements */
  readonly matrix_uncertainty: number;
}

/** A setting whose value differs from the profile, with both values. */
export interface SettingDifference {
  /** as on the page Configure */
  readonly title: string;
  readonly unit: string;
  /** as text; empty if the profile does not have it */
  readonly profile: string;
  /** the same for the robot */
  readonly robot: string;
}

/** Changes of a client to the settings of the device. */
export interface SettingsChange {
  readonly client: string;
  /** unix s */
  readonly time: number;
  readonly rows: readonly ChangedValue[];
  /** titles of settings that it may have changed, and were not read since */
  readonly unread: readonly string[];
  /** name of the snapshot after it; empty if there is none */
  readonly snapshot: string;
}

/** A request for a comparison of settings. */
export interface SettingsRequest {
  readonly a: ComparedSide;
  readonly b: ComparedSide;
}

/** A program that is connected to a share, with its counts of bytes. */
export interface ShareClient {
  readonly number: number;
  /** address, or path of the terminal */
  readonly peer: string;
  /** its program, where that is visible to this server; else as `peer` */
  readonly name: string;
  readonly may_write: boolean;
  /** what it sends waits until another is finished */
  readonly waits: boolean;
  /** bytes to it */
  readonly sent: number;
  /** bytes from it */
  readonly received: number;
  /** bytes from it that the device did not get: it may only read, or the device was not free in time */
  readonly refused: number;
  /** it sends more than the line carries, and is held back */
  readonly limited: boolean;
  /** lost because it did not read in time */
  readonly dropped_bytes: number;
  /** of those, whole frames */
  readonly dropped_frames: number;
}

/** The shares of the port of a device. */
export interface SharedPort {
  /** why the port cannot be shared; empty if it can */
  readonly why_not: string;
  /** folder in which a terminal can be created from the page; empty if there is none */
  readonly folder: string;
  /** process that holds the port; 0 for this server */
  readonly holder: number;
  /** who talks to the device now: a client, `imuscope`, or empty */
  readonly speaker: string;
  /** the speaker configures the device: imuscope waits with what it sends */
  readonly configuring: boolean;
  /** what clients changed last, newest first */
  readonly changes: readonly SettingsChange[];
  readonly shares: readonly PortShare[];
}

/** Figures of one signal; null where there is none. */
export interface SignalFigures {
  readonly signal: string;
  readonly device: string;
  /** for the figures that have a unit */
  readonly units: Readonly<Record<string, string>>;
  /** by name: a number, a text, a list of figures or an object of figures; `notes` are sentences */
  readonly figures: Readonly<Record<string, unknown>>;
}

/** The definition of a computed signal. */
export interface SignalText {
  readonly expression: string;
}

/** A signal that occurs in the store, for completion in the editor. */
export interface SignalWord {
  readonly name: string;
  readonly unit: string;
}

/** Rest in each of the six positions, and the present position. */
export interface SixPositions {
  readonly positions: readonly RestPosition[];
  /** the position that the sensor is in: "+x" …; "" between two */
  readonly now: string;
  /** rest in each position from which it counts */
  readonly seconds: number;
}

/** An SQL function that queries may call, for completion in the editor. */
export interface SqlFunction {
  readonly name: string;
  readonly form: string;
  readonly doc: string;
}

/** Kind and options of a live calibration. */
export interface StartCalibrationRequest {
  /** strength of the magnetic field there, in the unit of the signal; 0: unknown */
  readonly field?: number;
  /** m/s² there; 0: unknown (accelerometer) */
  readonly gravity?: number;
  /** the housing is square and rests on a level table (accelerometer) */
  readonly square?: boolean;
  /** where z of the vehicle points; null: as the device has it (mounting) */
  readonly vertical?: "up" | "down" | null;
  readonly kind: "gyroscope" | "magnetometer" | "accelerometer" | "mounting";
}

/** A topic to publish, or no longer. */
export interface SwitchTopicRequest {
  /** of the topic, as listed */
  readonly key: string;
  readonly enabled: boolean;
}

/** Name, type and meaning of a column of the store. */
export interface TableColumnInfo {
  readonly name: string;
  readonly type: string;
  readonly doc: string;
}

/** A table that queries can use, with its columns. */
export interface TableInfo {
  readonly name: string;
  readonly doc: string;
  readonly columns: readonly TableColumnInfo[];
}

/** A table as it will be read. */
export interface TablePreview {
  readonly separator: string;
  readonly decimal: string;
  readonly skipped: number;
  readonly columns: readonly PreviewColumn[];
  readonly clocks: Readonly<Record<string, string>>;
  readonly clock: string;
  readonly time_column: string;
  readonly units: readonly UnitChoice[];
  readonly unit: string;
  readonly rate: number | null;
  readonly epoch: string;
  readonly sure: string;
  readonly sentences: readonly string[];
  readonly times: readonly (number | null)[];
  readonly rows: readonly (readonly (string | number | null)[])[];
  readonly about: "time" | "unit" | "order" | "rate" | "";
  readonly problem: string;
  readonly hint: string;
  readonly heading: readonly string[];
}

/** Consent to end what a program does. */
export interface TakeOverRequest {
  /** the person has read which program is interrupted */
  readonly confirmed?: boolean;
}

/** A unit that the times can have: samples per second in it, null if unknown; whether that is plausible. */
export interface UnitChoice {
  readonly unit: string;
  readonly rate: number | null;
  readonly is_plausible: boolean;
}

/** Uploads of this robot's recordings. */
export interface UploadsState {
  /** whether finished recordings are uploaded: `[store] upload = true` */
  readonly enabled: boolean;
  /** URL or folder; empty if none is uploaded */
  readonly store: string;
  /** name of this robot in the store */
  readonly robot: string;
  /** why the last attempt failed, if the store cannot be used; it is tried again */
  readonly problem: string;
  /** finished recordings, in the order of the library */
  readonly recordings: readonly RecordingUpload[];
}

/** Share of a recording that a viewer in a browser gets: rows of all quantities together, in the recording and shown; `most` rows of one quantity (0: all), which is one of `every` samples of the largest; and the longest time range that opens without thinning, s. */
export interface ViewerQuery {
  readonly rows: number;
  readonly shown: number;
  readonly most: number;
  readonly every: number;
  readonly whole_s: number;
}

/** A stored workspace with its content. */
export interface WorkspaceBody {
  readonly name: string;
  /** unix seconds */
  readonly modified: number;
  /** changes with every change; also the ETag */
  readonly revision: string;
  /** format, version and parts, as the page exports it */
  readonly workspace: Readonly<Record<string, unknown>>;
}

/** Name, revision and time of a stored workspace, without its content. */
export interface WorkspaceInfo {
  readonly name: string;
  /** unix seconds */
  readonly modified: number;
  /** changes with every change; also the ETag */
  readonly revision: string;
}

/** All workspaces, and the one that devices of a family open with. */
export interface WorkspaceList {
  readonly workspaces: readonly WorkspaceInfo[];
  /** name of a workspace by protocol family */
  readonly defaults: Readonly<Record<string, string>>;
}

export interface Routes {
  /** Every device with its link and state. */
  "GET /api/devices": { readonly answer: readonly DeviceInfo[]; };
  /** Open a source. Answers at once; the progress is sent over the WebSocket. */
  "POST /api/devices": {
    readonly body: AddDeviceRequest;
    readonly answer: DeviceInfo;
  };
  /** Close a device and forget it. A device with a pending rollback stays until the change is confirmed or rolled back. */
  "DELETE /api/devices/{device}": {
    readonly path: { readonly device: string };
    readonly answer: undefined;
  };
  /** Try the link now instead of at `next_attempt`; play an ended file again. */
  "POST /api/devices/{device}/retry": {
    readonly path: { readonly device: string };
    readonly answer: DeviceInfo;
  };
  /** Decode future bytes with other options: the given options change, the others and the device stay. A `schema` is added to the existing descriptions. */
  "POST /api/devices/{device}/decode-options": {
    readonly path: { readonly device: string };
    readonly body: DecodeOptionsBody;
    readonly answer: DeviceInfo;
  };
  /** Name a sensor. The name is kept with its serial number, so it follows the sensor to other ports and runs; nothing is written to the device. */
  "PUT /api/devices/{device}/name": {
    readonly path: { readonly device: string };
    readonly body: NameDeviceRequest;
    readonly answer: DeviceInfo;
  };
  /** Accept any sequence number that a Secure device sends next. Use it only after restarting the device: until its next frame arrives, replayed old frames would be accepted as new. */
  "POST /api/devices/{device}/rearm": {
    readonly path: { readonly device: string };
    readonly body: RearmDeviceRequest;
    readonly answer: DeviceInfo;
  };
  /** Queue, running job, pending rollback, last results. */
  "GET /api/devices/{device}/jobs": {
    readonly path: { readonly device: string };
    readonly answer: DeviceJobs;
  };
  /** The traffic log, newest last. */
  "GET /api/devices/{device}/traffic": {
    readonly path: { readonly device: string };
    readonly query?: { readonly before?: number | null | undefined; readonly limit?: number | undefined };
    readonly answer: readonly TrafficEntry[];
  };
  /** Read settings into a snapshot. The device does not measure while it is read. */
  "POST /api/devices/{device}/read": {
    readonly path: { readonly device: string };
    readonly body: Defaulted<ReadRequest, "settings" | "reason" | "confirmed">;
    readonly answer: Job;
  };
  /** Figures of the device: messages and rates, losses, clock, load of the link. 409 until it has sent something. */
  "GET /api/devices/{device}/health": {
    readonly path: { readonly device: string };
    readonly answer: DeviceHealth;
  };
  /** Write settings: snapshot, difference, write, read back; temporary until confirmed where the link could be lost, or whatever they are with `confirm_s`. Devices that are named by their key are written only if this sensor is still there. */
  "POST /api/devices/{device}/apply": {
    readonly path: { readonly device: string };
    readonly body: Defaulted<ApplyRequest, "reason" | "confirmed" | "devices" | "product" | "base" | "confirm_s">;
    readonly answer: Job;
  };
  /** Run a command. A command that writes a setting is applied like any change, with snapshot and rollback. */
  "POST /api/devices/{device}/run": {
    readonly path: { readonly device: string };
    readonly body: Defaulted<RunRequest, "values" | "confirmed">;
    readonly answer: Job;
  };
  /** Send bytes unchanged. They are not checked, so they are sent only when `confirmed`, unless they are one message that only asks. 409 names what they are and do. */
  "POST /api/devices/{device}/raw": {
    readonly path: { readonly device: string };
    readonly body: Defaulted<RawRequest, "confirmed">;
    readonly answer: Job;
  };
  /** Confirm the pending change: the new settings stay. */
  "POST /api/devices/{device}/confirm": {
    readonly path: { readonly device: string };
    readonly answer: DeviceJobs;
  };
  /** Roll the pending change back now. */
  "POST /api/devices/{device}/roll-back": {
    readonly path: { readonly device: string };
    readonly answer: DeviceJobs;
  };
  /** Guided procedure for a device that does not answer at any baud rate. */
  "POST /api/devices/{device}/restore": {
    readonly path: { readonly device: string };
    readonly answer: Job;
  };
  /** Take a job out of the queue, or stop it; the device measures again. */
  "DELETE /api/devices/{device}/jobs/{job}": {
    readonly path: { readonly job: number; readonly device: string };
    readonly answer: undefined;
  };
  /** Every setting and command, as forms. */
  "GET /api/devices/{device}/forms": {
    readonly path: { readonly device: string };
    readonly answer: Forms;
  };
  /** The frames with the meaning of each byte, problems of the values, and the load of the line. */
  "POST /api/devices/{device}/preview": {
    readonly path: { readonly device: string };
    readonly body: Defaulted<PreviewRequest, "setting" | "command">;
    readonly answer: PreviewResult;
  };
  /** The same outputs with rates that the line can carry. */
  "POST /api/devices/{device}/fit-rates": {
    readonly path: { readonly device: string };
    readonly body: Defaulted<FitRatesRequest, "baud">;
    readonly answer: FitRatesResult;
  };
  /** Every command and setting of every protocol, all products together; GET …/forms has those of one device. */
  "GET /api/commands": { readonly answer: readonly Forms[]; };
  /** Values of the device as last read or written; `taken` 0: never read. */
  "GET /api/devices/{device}/values": {
    readonly path: { readonly device: string };
    readonly answer: SnapshotBody;
  };
  /** Snapshots, newest first. Empty while the device's serial number is not known. */
  "GET /api/devices/{device}/snapshots": {
    readonly path: { readonly device: string };
    readonly answer: readonly SnapshotInfo[];
  };
  /** Store a snapshot under a name: a given text, or the settings of the device as last read. */
  "POST /api/devices/{device}/snapshots": {
    readonly path: { readonly device: string };
    readonly body: Defaulted<SaveRequest, "text">;
    readonly answer: SnapshotInfo;
  };
  /** A snapshot as YAML for reading, or as JSON for programs. */
  "GET /api/devices/{device}/snapshots/{name}": {
    readonly path: { readonly name: string; readonly device: string };
    readonly query?: { readonly format?: "yaml" | "json" | undefined };
    readonly answer: SnapshotBody | string;
  };
  /** Delete a snapshot and its file. */
  "DELETE /api/devices/{device}/snapshots/{name}": {
    readonly path: { readonly name: string; readonly device: string };
    readonly answer: undefined;
  };
  /** Compare two sides field by field, with the changes that would make the left side equal the right one. */
  "POST /api/devices/{device}/compare": {
    readonly path: { readonly device: string };
    readonly body: Defaulted<CompareRequest, "take" | "take_rest">;
    readonly answer: Difference;
  };
  /** The frame that made a sample of a live device, and its neighbours, as far as its bytes are in memory: each frame as `imuscope inspect` lists it, with the meaning of each byte. */
  "GET /api/devices/{device}/frames": {
    readonly path: { readonly device: string };
    readonly query: { readonly time: number; readonly base?: "device" | "arrival" | undefined; readonly channel?: number | null | undefined; readonly rank?: number | undefined; readonly kind?: "" | "frame" | "reject" | "foreign" | "sent" | undefined; readonly beside?: number | undefined };
    readonly answer: PacketView;
  };
  /** The frame that made a sample of a recording, and its neighbours, as for a live device. */
  "GET /api/recordings/{recording}/frames": {
    readonly path: { readonly recording: string };
    readonly query: { readonly time: number; readonly device?: string | undefined; readonly base?: "device" | "arrival" | undefined; readonly channel?: number | null | undefined; readonly rank?: number | undefined; readonly kind?: "" | "frame" | "reject" | "foreign" | "sent" | undefined; readonly beside?: number | undefined };
    readonly answer: PacketView;
  };
  /** State of the recorder. */
  "GET /api/recorder": { readonly answer: RecorderState; };
  /** Record these devices, or all of them, into a new file. */
  "POST /api/recordings/start": {
    readonly body: Defaulted<StartRequest, "devices" | "title" | "before_s" | "with_head">;
    readonly answer: RecorderState;
  };
  /** The bytes of each live link that are in memory, and so can be saved. */
  "GET /api/recorder/memory": { readonly answer: readonly HeldBytes[]; };
  /** Save the last bytes of these devices, or of all, from memory as a recording; answers when it is complete. */
  "POST /api/recordings/save-memory": {
    readonly body: Defaulted<SaveMemoryRequest, "devices" | "seconds" | "t0" | "t1" | "title">;
    readonly answer: SavedMemory;
  };
  /** Read the configuration of each MTi that the running recording lacks (`headless`), for an .mtb export. It pauses the device for about 90 ms. */
  "POST /api/recordings/read-headers": { readonly answer: RecorderState; };
  /** Stop recording; the file is complete when this answers. */
  "POST /api/recordings/stop": { readonly answer: RecorderState; };
  /** Add a marker or a note to the running recording. */
  "POST /api/recordings/mark": {
    readonly body: Defaulted<MarkerRequest, "text" | "kind" | "time" | "device">;
    readonly answer: RecorderState;
  };
  /** Begin an export; its progress is sent with the op `exports`. */
  "POST /api/recordings/{recording}/exports": {
    readonly path: { readonly recording: string };
    readonly body: Defaulted<ExportJobRequest, "device" | "t0" | "t1" | "channels" | "base">;
    readonly answer: ExportJob;
  };
  /** Estimated sizes of exports, from writing a sample of each. */
  "POST /api/recordings/{recording}/export-sizes": {
    readonly path: { readonly recording: string };
    readonly body: Defaulted<ExportSelection, "t0" | "t1" | "channels" | "base">;
    readonly answer: ExportSizes;
  };
  /** Newest first. */
  "GET /api/recordings/exports": { readonly answer: readonly ExportJob[]; };
  /** Download the result of an export; several files come as a zip. */
  "GET /api/recordings/exports/{job}/file": {
    readonly path: { readonly job: number };
    readonly answer: Blob;
  };
  /** Cancel an export, or delete it and its file. */
  "DELETE /api/recordings/exports/{job}": {
    readonly path: { readonly job: number };
    readonly answer: undefined;
  };
  /** All recordings, newest first; then those in the bin, which have `deleted`. */
  "GET /api/recordings": {
    readonly query?: { readonly q?: string | undefined };
    readonly answer: readonly RecordingInfo[];
  };
  /** Upload a file of any readable format; the body is the file (application/octet-stream). */
  "PUT /api/recordings/upload": {
    readonly query: { readonly name: string };
    readonly body: Blob;
    readonly answer: RecordingInfo;
  };
  /** Change title, tags, notes, pinned or the file's name; null keeps a value. Renaming the file changes the id. */
  "PATCH /api/recordings/{recording}": {
    readonly path: { readonly recording: string };
    readonly body: Defaulted<EditRequest, "title" | "tags" | "notes" | "notes_before" | "pinned" | "file">;
    readonly answer: RecordingInfo;
  };
  /** Move a recording to the bin, from where it can be restored for 7 days. */
  "DELETE /api/recordings/{recording}": {
    readonly path: { readonly recording: string };
    readonly answer: RecordingInfo;
  };
  /** Details of a recording without its samples (RecordingDetail). 202 with an OpeningState while it is decoded for the first time; with `partial`, the RecordingDetail of the part decoded so far, with `progress` below 1. */
  "GET /api/recordings/{recording}": {
    readonly path: { readonly recording: string };
    readonly query?: { readonly partial?: boolean | undefined };
    readonly answer: RecordingDetail | OpeningState;
  };
  /** Add a marker or a note to a finished recording. */
  "POST /api/recordings/{recording}/markers": {
    readonly path: { readonly recording: string };
    readonly body: Defaulted<MarkerRequest, "text" | "kind" | "time" | "device">;
    readonly answer: MarkerInfo;
  };
  /** Restore a recording from the bin. */
  "POST /api/recordings/{recording}/undelete": {
    readonly path: { readonly recording: string };
    readonly answer: RecordingInfo;
  };
  /** One file with bytes, times, events, markers, title, tags and notes (MCAP; CSV for a CSV recording). */
  "GET /api/recordings/{recording}/download": {
    readonly path: { readonly recording: string };
    readonly answer: Blob;
  };
  /** The received bytes of one device, unchanged and in order. */
  "GET /api/recordings/{recording}/original": {
    readonly path: { readonly recording: string };
    readonly query?: { readonly device?: string | undefined };
    readonly answer: Blob;
  };
  /** Play a recording. Each of its devices appears, ends with the file, and can be played again or removed. */
  "POST /api/recordings/{recording}/play": {
    readonly path: { readonly recording: string };
    readonly body: Defaulted<PlayRequest, "speed" | "loop" | "t0" | "t1">;
    readonly answer: readonly DeviceInfo[];
  };
  /** Sample frames of the wire; a bucket is two rows (min, max). `X-Exact: 1` when no channel is summarised. */
  "GET /api/recordings/{recording}/window": {
    readonly path: { readonly recording: string };
    readonly query: { readonly t0: number; readonly t1: number; readonly width?: number | undefined; readonly base?: "device" | "arrival" | undefined; readonly channels?: string | undefined; readonly partial?: boolean | undefined };
    readonly answer: Blob;
  };
  /** Count, mean, σ, min and max of every column of channels over a time range of any length, by channel. */
  "GET /api/recordings/{recording}/statistics": {
    readonly path: { readonly recording: string };
    readonly query: { readonly t0: number; readonly t1: number; readonly base?: "device" | "arrival" | undefined; readonly channels?: string | undefined; readonly partial?: boolean | undefined };
    readonly answer: Readonly<Record<string, readonly ColumnStatistics[]>>;
  };
  /** Per-second figures of a device: bytes, samples of each message, arrival delay, clock. */
  "GET /api/recordings/{recording}/health": {
    readonly path: { readonly recording: string };
    readonly query: { readonly device: string; readonly t0: number; readonly t1: number; readonly partial?: boolean | undefined };
    readonly answer: HealthHistory;
  };
  /** Settings of a device at the time of recording, worded as in Configure; empty if none were recorded. */
  "GET /api/recordings/{recording}/settings": {
    readonly path: { readonly recording: string };
    readonly query: { readonly device: string; readonly partial?: boolean | undefined };
    readonly answer: RecordedSettings;
  };
  /** One channel as a table: Arrow or JSON, every row or summarised in buckets. */
  "GET /api/recordings/{recording}/query": {
    readonly path: { readonly recording: string };
    readonly query: { readonly channel: string; readonly t0?: number | null | undefined; readonly t1?: number | null | undefined; readonly width?: number | undefined; readonly columns?: string | undefined; readonly base?: "device" | "arrival" | undefined; readonly format?: "arrow" | "json" | undefined; readonly device?: string | undefined };
    readonly answer: Blob | ChannelTable;
  };
  /** Samples of a live channel in memory, as a table, with the parameters of the query on a recording. */
  "GET /api/devices/{device}/query": {
    readonly path: { readonly device: string };
    readonly query: { readonly channel: string; readonly t0?: number | null | undefined; readonly t1?: number | null | undefined; readonly width?: number | undefined; readonly columns?: string | undefined; readonly base?: "device" | "arrival" | undefined; readonly format?: "arrow" | "json" | undefined };
    readonly answer: Blob | ChannelTable;
  };
  /** Workspaces by name, and the default of each family. */
  "GET /api/workspaces": { readonly answer: WorkspaceList; };
  /** A workspace with its content. */
  "GET /api/workspaces/{name}": {
    readonly path: { readonly name: string };
    readonly answer: WorkspaceBody;
  };
  /** Store a workspace. With `If-Match` it replaces that revision; without, there must be none of that name. */
  "PUT /api/workspaces/{name}": {
    readonly path: { readonly name: string };
    readonly body: SaveWorkspaceRequest;
    readonly answer: WorkspaceBody;
  };
  /** Delete a workspace; with `If-Match` only that revision. */
  "DELETE /api/workspaces/{name}": {
    readonly path: { readonly name: string };
    readonly answer: undefined;
  };
  /** Set the workspace that devices of a protocol family open with. Answers with those of all families. */
  "PUT /api/workspace-defaults/{family}": {
    readonly path: { readonly family: string };
    readonly body: DefaultWorkspaceRequest;
    readonly answer: Readonly<Record<string, string>>;
  };
  /** The serial ports of this host, without opening them. */
  "GET /api/ports": { readonly answer: readonly PortInfo[]; };
  /** Listen on every free port, at one rate after another; takes some seconds. Ports of sessions are left alone. */
  "POST /api/ports/scan": {
    readonly body?: ScanPortsRequest | null;
    readonly answer: readonly PortInfo[];
  };
  /** Versions, the id of this run, and the role of the request's token. */
  "GET /api/build": { readonly answer: Build; };
  /** Health check. Needs no token; contains no device data but the number of devices. */
  "GET /healthz": { readonly answer: HealthStatus; };
  /** Metrics in the text format of Prometheus (server/diagnostics/metrics.py). They contain device data, so requests from other machines need a bearer token; a view token is sufficient. */
  "GET /metrics": { readonly answer: string; };
  /** Everything that is registered, as sent to the page in `hello`. */
  "GET /api/capabilities": { readonly answer: Capabilities; };
  /** Whether a tile server is configured, and its attribution. */
  "GET /api/map": { readonly answer: MapInfo; };
  /** An image of 256 by 256 pixels: column x and row y (from the north) of the 2^z by 2^z tiles of the world. */
  "GET /api/tiles/{z}/{x}/{y}": {
    readonly path: { readonly z: number; readonly x: number; readonly y: number };
    readonly answer: Blob;
  };
  /** Installed extensions, each after those that it requires. */
  "GET /api/extensions": { readonly answer: readonly InstalledExtension[]; };
  /** Analyses with their options. */
  "GET /api/analysis": { readonly answer: readonly AnalysisInfo[]; };
  /** Pairs of two signals at the same moments, for a plot of one over the other. */
  "POST /api/analysis/pairs": {
    readonly body: PairsRequest;
    readonly answer: PairsInfo;
  };
  /** Analyse signals of a recording, or of a live device as far as memory holds them. */
  "POST /api/analysis/{name}": {
    readonly path: { readonly name: string };
    readonly body: AnalysisRequest;
    readonly answer: readonly SignalFigures[] | Blob;
  };
  /** Compare signals of two sources, or of two ranges of one, aligned in time. */
  "POST /api/comparison": {
    readonly body: ComparisonRequest;
    readonly answer: ComparisonAnswer;
  };
  /** Compare settings of two sides: as recorded, or of a live device as last read. `left` is A, `right` is B. */
  "POST /api/comparison/settings": {
    readonly body: SettingsRequest;
    readonly answer: Difference;
  };
  /** Functions and units of expressions, for completion. */
  "GET /api/signals/words": { readonly answer: ExpressionWords; };
  /** Computed signals of a device. */
  "GET /api/devices/{device}/signals": {
    readonly path: { readonly device: string };
    readonly answer: readonly ComputedSignal[];
  };
  /** Compute a signal as a channel of the device, also after a restart, in place of the one of that name. */
  "PUT /api/devices/{device}/signals/{name}": {
    readonly path: { readonly device: string; readonly name: string };
    readonly body: SignalText;
    readonly answer: ComputedSignal;
  };
  /** Remove a computed signal with its channel; refused while other signals use it. */
  "DELETE /api/devices/{device}/signals/{name}": {
    readonly path: { readonly device: string; readonly name: string };
    readonly answer: undefined;
  };
  /** Every clock of an opened recording: unit, epoch, resolution, drift and jitter against the axis, steps. */
  "GET /api/recordings/{recording}/clocks": {
    readonly path: { readonly recording: string };
    readonly answer: FileTime;
  };
  /** Every clock of the link of a live device, over its bytes in memory, and how they arrive. */
  "GET /api/devices/{device}/clocks": {
    readonly path: { readonly device: string };
    readonly answer: LiveTime;
  };
  /** Choices on how a recording is read, and the open question of its table. */
  "GET /api/recordings/{recording}/reading": {
    readonly path: { readonly recording: string };
    readonly answer: ReadingState;
  };
  /** Choose how a recording is read. It is kept with it; a table's choices apply to later ones with its heading. */
  "PUT /api/recordings/{recording}/reading": {
    readonly path: { readonly recording: string };
    readonly body: FileReadingBody;
    readonly answer: ReadingState;
  };
  /** Read a recording as the file itself says, and forget the choices for its heading. */
  "DELETE /api/recordings/{recording}/reading": {
    readonly path: { readonly recording: string };
    readonly answer: ReadingState;
  };
  /** The first rows of a table as they will be read with these choices alone. */
  "POST /api/recordings/{recording}/reading/preview": {
    readonly path: { readonly recording: string };
    readonly body: FileReadingBody;
    readonly answer: TablePreview;
  };
  /** The stream that is forwarded; an empty source if there is none. The password is never returned. */
  "GET /api/devices/{device}/corrections": {
    readonly path: { readonly device: string };
    readonly answer: Corrections;
  };
  /** Forward this stream in place of the previous one. */
  "PUT /api/devices/{device}/corrections": {
    readonly path: { readonly device: string };
    readonly body: CorrectionsRequest;
    readonly answer: Corrections;
  };
  /** Stop forwarding; returns the final counters. */
  "DELETE /api/devices/{device}/corrections": {
    readonly path: { readonly device: string };
    readonly answer: Corrections;
  };
  /** The recording for a Rerun viewer, sent while it is converted; static data first. */
  "GET /api/recordings/{recording}/recording.rrd": {
    readonly path: { readonly recording: string };
    readonly query?: { readonly t0?: number | null | undefined; readonly t1?: number | null | undefined; readonly most?: number | undefined };
    readonly answer: Blob;
  };
  /** Share of the recording that the embedded Rerun viewer gets: a browser cannot hold an hour of a fast device. */
  "GET /api/recordings/{recording}/amount": {
    readonly path: { readonly recording: string };
    readonly query?: { readonly t0?: number | null | undefined; readonly t1?: number | null | undefined; readonly all?: boolean | undefined };
    readonly answer: ViewerQuery;
  };
  /** The publisher, its topics and their subscribers; figures are renewed once a second. */
  "GET /api/ros2": { readonly answer: RosState; };
  /** Publish a topic, or no longer; the choice outlasts the server. */
  "PATCH /api/ros2/topics": {
    readonly body: SwitchTopicRequest;
    readonly answer: RosState;
  };
  /** The shares with their clients. */
  "GET /api/devices/{device}/shares": {
    readonly path: { readonly device: string };
    readonly answer: SharedPort;
  };
  /** Share the port. For the first share the link is opened again, by a process that stays when this server ends. */
  "POST /api/devices/{device}/shares": {
    readonly path: { readonly device: string };
    readonly body: AddShareRequest;
    readonly answer: SharedPort;
  };
  /** End a share and disconnect its clients. */
  "DELETE /api/devices/{device}/shares": {
    readonly path: { readonly device: string };
    readonly query: { readonly name: string };
    readonly answer: SharedPort;
  };
  /** End a configuration that a program has begun and not finished, so that others may talk to the device. 409 names the program until it is `confirmed`. */
  "POST /api/devices/{device}/shares/take-over": {
    readonly path: { readonly device: string };
    readonly body: TakeOverRequest;
    readonly answer: SharedPort;
  };
  /** Disconnect a client; it may connect again. */
  "DELETE /api/devices/{device}/shares/clients/{number}": {
    readonly path: { readonly number: number; readonly device: string };
    readonly answer: SharedPort;
  };
  /** Begin a 3D scene; returns its address as soon as it can be opened. */
  "GET /api/views/scene": {
    readonly query?: { readonly device?: string | undefined };
    readonly answer: SceneAddress;
  };
  /** All alarms with their states. */
  "GET /api/alarms": { readonly answer: readonly AlarmInfo[]; };
  /** Add an alarm. It is checked against the present devices that it is for. */
  "POST /api/alarms": {
    readonly body: AlarmDefinition;
    readonly answer: AlarmInfo;
  };
  /** Check a definition without adding it, with the place of a mistake. */
  "POST /api/alarms/check": {
    readonly body: AlarmDefinition;
    readonly answer: AlarmCheck;
  };
  /** Preview how often an alarm would have been raised, live in the last minutes or in a whole recording. */
  "POST /api/alarms/preview": {
    readonly body: AlarmPreviewRequest;
    readonly answer: AlarmPreview;
  };
  /** One alarm with its states. */
  "GET /api/alarms/{alarm}": {
    readonly path: { readonly alarm: string };
    readonly answer: AlarmInfo;
  };
  /** Replace the definition of an alarm; its states are reset. */
  "PUT /api/alarms/{alarm}": {
    readonly path: { readonly alarm: string };
    readonly body: AlarmDefinition;
    readonly answer: AlarmInfo;
  };
  /** Delete an alarm with its states. */
  "DELETE /api/alarms/{alarm}": {
    readonly path: { readonly alarm: string };
    readonly answer: undefined;
  };
  /** Acknowledge a raised alarm by name. A latched one that is within its limit again is cleared by it. */
  "POST /api/alarms/{alarm}/acknowledge": {
    readonly path: { readonly alarm: string };
    readonly body: AcknowledgeRequest;
    readonly answer: AlarmInfo;
  };
  /** Calibrations that a live device allows, and the one under way with its progress or result. */
  "GET /api/devices/{device}/calibration": {
    readonly path: { readonly device: string };
    readonly answer: CalibrationState;
  };
  /** Start a calibration of a live device, in place of an earlier one. It uses the samples from now on. */
  "POST /api/devices/{device}/calibration": {
    readonly path: { readonly device: string };
    readonly body: StartCalibrationRequest;
    readonly answer: CalibrationState;
  };
  /** Stop the calibration and discard its result. The device is not changed. */
  "DELETE /api/devices/{device}/calibration": {
    readonly path: { readonly device: string };
    readonly answer: undefined;
  };
  /** End the calibration with the samples until now. Refused while they do not determine a result. */
  "POST /api/devices/{device}/calibration/finish": {
    readonly path: { readonly device: string };
    readonly answer: CalibrationState;
  };
  /** The result as a file: JSON, YAML, CSV or a C header. */
  "GET /api/devices/{device}/calibration/export": {
    readonly path: { readonly device: string };
    readonly query?: { readonly format?: "json" | "yaml" | "csv" | "c" | undefined };
    readonly answer: string;
  };
  /** Calibrate with a stretch of a recording, or of a live device as far as memory holds it. */
  "POST /api/calibration/{kind}": {
    readonly path: { readonly kind: "gyroscope" | "magnetometer" | "accelerometer" | "mounting" };
    readonly body: CalibrationRequest;
    readonly answer: CalibrationReport | string;
  };
  /** Begin to make evidence: one HTML file with plots, figures, notes, events and settings; a job like an export. */
  "POST /api/recordings/{recording}/evidence": {
    readonly path: { readonly recording: string };
    readonly body: EvidenceRequest;
    readonly answer: ExportJob;
  };
  /** The store of this server, its limits, and the questions of this client that wait or run. */
  "GET /api/query": { readonly answer: QueryState; };
  /** Ask the store a question. The answer ends with the connection: closing it cancels the question. */
  "POST /api/query": {
    readonly body: QueryBody;
    readonly answer: QueryAnswer | Blob;
  };
  /** Prepared questions with their SQL. */
  "GET /api/query/questions": { readonly answer: readonly PreparedQuestionInfo[]; };
  /** Tables with their columns, signals, and functions of SQL: what an editor completes. */
  "GET /api/query/tables": { readonly answer: QueryWords; };
  /** Fetch a recording of the store into the library, unless it is there, and compare its checksum. */
  "POST /api/query/recordings/{recording}/fetch": {
    readonly path: { readonly recording: string };
    readonly answer: FetchedRecording;
  };
  /** State of the uploads, of each finished recording. */
  "GET /api/uploads": { readonly answer: UploadsState; };
  /** Robots of the fleet, at a glance. */
  "GET /api/fleet/robots": {
    readonly query?: { readonly after?: number | null | undefined };
    readonly answer: FleetRobots;
  };
  /** Remove a robot that is lost, for good, from the list. Its events stay. One that joins again is listed again. */
  "DELETE /api/fleet/robots/{robot}": {
    readonly path: { readonly robot: string };
    readonly answer: undefined;
  };
  /** Acknowledge an alarm of the fleet server. Those of a robot are acknowledged on its own page. */
  "POST /api/fleet/robots/{robot}/acknowledge": {
    readonly path: { readonly robot: string };
    readonly body: FleetAcknowledgement;
    readonly answer: undefined;
  };
  /** Events of all robots, the newest first, each once. They are stored within a second of their arrival. */
  "GET /api/fleet/events": {
    readonly query?: { readonly robot?: string | undefined; readonly before?: number | null | undefined; readonly limit?: number | undefined };
    readonly answer: readonly FleetEvent[];
  };
  /** Settings of a robot's devices against the profiles of its group. */
  "GET /api/fleet/robots/{robot}/settings": {
    readonly path: { readonly robot: string };
    readonly answer: readonly DeviceSettingsCheck[];
  };
  /** Make the settings of a device the profile of its group, for its product. Nothing is written to any robot. */
  "POST /api/fleet/robots/{robot}/profile": {
    readonly path: { readonly robot: string };
    readonly body: ProfileRequest;
    readonly answer: readonly DeviceSettingsCheck[];
  };
  /** Remove the profile that a device is compared with. */
  "DELETE /api/fleet/robots/{robot}/profile": {
    readonly path: { readonly robot: string };
    readonly query: { readonly device: string; readonly by: string };
    readonly answer: readonly DeviceSettingsCheck[];
  };
  /** Plan of a rollout: devices of the group that differ from the profile that this one is compared with. */
  "GET /api/fleet/robots/{robot}/rollout": {
    readonly path: { readonly robot: string };
    readonly query: { readonly device: string; readonly waves?: string | undefined };
    readonly answer: RolloutPlan;
  };
  /** Carry a plan out, in waves. Each device is written to with settings that are temporary until they are confirmed: once it has delivered for `watch_s` at the rate of the profile, with the settings of the profile. Otherwise the robot rolls back by itself, and no further wave begins. 412 if the plan has changed. */
  "POST /api/fleet/robots/{robot}/rollout": {
    readonly path: { readonly robot: string };
    readonly body: RolloutRequest;
    readonly answer: Rollout;
  };
  /** Rollouts, the newest first. */
  "GET /api/fleet/rollouts": { readonly answer: readonly RolloutHead[]; };
  /** A rollout, with the state of each device. */
  "GET /api/fleet/rollouts/{rollout}": {
    readonly path: { readonly rollout: number };
    readonly answer: Rollout;
  };
  /** Begin with no further device. Those that are under way are finished: confirmed, or rolled back. */
  "POST /api/fleet/rollouts/{rollout}/stop": {
    readonly path: { readonly rollout: number };
    readonly body: RolloutStopRequest;
    readonly answer: Rollout;
  };
}
