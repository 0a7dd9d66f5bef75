"""Public names for plug-ins, by what they are for. See plugin.py."""

# Version of these names.
from imuscope.protocols import rotations as rotations
from imuscope.protocols.arrays import Bytes as Bytes
from imuscope.protocols.arrays import Ints as Ints
from imuscope.protocols.commands.composer import ProtocolComposer as ProtocolComposer
from imuscope.protocols.commands.mounting import MountingSetting as MountingSetting
from imuscope.protocols.commands.rate_tables import RateTable as RateTable

# Drivers and simulated devices.
from imuscope.protocols.commands.transactions import ByteRange as ByteRange
from imuscope.protocols.commands.transactions import DeviceContext as DeviceContext
from imuscope.protocols.commands.transactions import DeviceDriver as DeviceDriver
from imuscope.protocols.commands.transactions import DeviceRejectedError as DeviceRejectedError
from imuscope.protocols.commands.transactions import NoReplyError as NoReplyError
from imuscope.protocols.commands.transactions import Send as Send
from imuscope.protocols.commands.transactions import Transaction as Transaction
from imuscope.protocols.commands.transactions import Values as Values
from imuscope.protocols.commands.transactions import WaitFor as WaitFor
from imuscope.protocols.commands.transactions import WriteResult as WriteResult
from imuscope.protocols.embedded.finders import STARTS as STARTS
from imuscope.protocols.embedded.finders import find as find
from imuscope.protocols.events import Batch as Batch
from imuscope.protocols.events import Decoder as Decoder
from imuscope.protocols.events import Event as Event
from imuscope.protocols.events import RejectedFrame as RejectedFrame
from imuscope.protocols.events import Reply as Reply
from imuscope.protocols.events import SampleGap as SampleGap
from imuscope.protocols.family.decode_options import DecodeOption as DecodeOption

# Protocol families.
from imuscope.protocols.family.info import ConfigurationTraits as ConfigurationTraits
from imuscope.protocols.family.info import CorrectionInput as CorrectionInput
from imuscope.protocols.family.info import Decoding as Decoding
from imuscope.protocols.family.info import DeviceTraits as DeviceTraits
from imuscope.protocols.family.info import FamilyHints as FamilyHints
from imuscope.protocols.family.info import FrameFormat as FrameFormat
from imuscope.protocols.family.info import LogFormat as LogFormat
from imuscope.protocols.family.info import LogHeader as LogHeader
from imuscope.protocols.family.info import LogName as LogName
from imuscope.protocols.family.info import PageWords as PageWords
from imuscope.protocols.family.info import PanelDefaults as PanelDefaults
from imuscope.protocols.family.info import PayloadDefinition as PayloadDefinition
from imuscope.protocols.family.info import PositionFix as PositionFix
from imuscope.protocols.family.info import ProtocolInfo as ProtocolInfo
from imuscope.protocols.family.info import RejectRemedy as RejectRemedy
from imuscope.protocols.family.info import StreamTraits as StreamTraits
from imuscope.protocols.family.info import VendorLogs as VendorLogs
from imuscope.protocols.family.plugins import API_VERSION as API_VERSION
from imuscope.protocols.family.sensor_properties import SensorProperties as SensorProperties

# Decoders: frames, streams, events.
from imuscope.protocols.framing.stream_buffer import BAD_CHECKSUM as BAD_CHECKSUM
from imuscope.protocols.framing.stream_buffer import BAD_SIZE as BAD_SIZE
from imuscope.protocols.framing.stream_buffer import FRAME as FRAME
from imuscope.protocols.framing.stream_buffer import ID as ID
from imuscope.protocols.framing.stream_buffer import OFFSET as OFFSET
from imuscope.protocols.framing.stream_buffer import SIZE as SIZE
from imuscope.protocols.framing.stream_buffer import TRUNCATED as TRUNCATED
from imuscope.protocols.framing.stream_parser import ParseResult as ParseResult
from imuscope.protocols.framing.stream_parser import StreamDecoder as StreamDecoder
from imuscope.protocols.framing.stream_parser import StreamParser as StreamParser
from imuscope.protocols.schema.fields import Bits as Bits
from imuscope.protocols.schema.fields import Command as Command
from imuscope.protocols.schema.fields import Direction as Direction
from imuscope.protocols.schema.fields import Field as Field
from imuscope.protocols.schema.fields import Message as Message
from imuscope.protocols.schema.fields import Setting as Setting
from imuscope.protocols.schema.layouts import EncodeError as EncodeError
from imuscope.protocols.schema.layouts import Layout as Layout
from imuscope.protocols.schema.layouts import pack as pack
from imuscope.protocols.schema.layouts import size_of as size_of
from imuscope.protocols.schema.layouts import unpack as unpack
from imuscope.protocols.simulator import trajectory as trajectory
from imuscope.protocols.simulator.family import SimulatedDevice as SimulatedDevice
from imuscope.protocols.simulator.family import SimulatorInfo as SimulatorInfo
from imuscope.protocols.simulator.family import SimulatorRequest as SimulatorRequest
from imuscope.recordings.errors import RecordingError as RecordingError

# Exporters and analyses.
from imuscope.recordings.exporters.registry import ExportFormat as ExportFormat
from imuscope.recordings.exporters.registry import register_exporter as register_exporter
from imuscope.recordings.exporters.request import ExportRequest as ExportRequest
from imuscope.recordings.exporters.request import ExportStep as ExportStep
from imuscope.recordings.readers.registry import FileReader as FileReader
from imuscope.recordings.readers.registry import OpenRequest as OpenRequest
from imuscope.recordings.readers.registry import register_reader as register_reader

# Readers.
from imuscope.recordings.sources import FileDamage as FileDamage
from imuscope.recordings.tables.table_rows import TableRows as TableRows
from imuscope.recordings.tables.table_source import TableSource as TableSource

# Extensions of the server.
from imuscope.server.api.dependencies import TheServices as TheServices
from imuscope.server.diagnostics.checks import Finding as Finding
from imuscope.server.extensions.analysis.noise.registry import Analysis as Analysis
from imuscope.server.extensions.analysis.noise.registry import AnalysisOption as AnalysisOption
from imuscope.server.extensions.analysis.noise.registry import Result as Result
from imuscope.server.extensions.analysis.noise.registry import register_analysis as register_analysis
from imuscope.server.extensions.analysis.signals.signals import Signal as Signal
from imuscope.server.library.computed_signals import SignalComputation as SignalComputation

# Links.
from imuscope.server.links.base import Chunk as Chunk
from imuscope.server.links.base import Link as Link
from imuscope.server.links.base import LinkError as LinkError
from imuscope.server.links.base import LinkSettings as LinkSettings
from imuscope.server.links.base import Progress as Progress
from imuscope.server.links.reader_thread import ThreadedLink as ThreadedLink
from imuscope.server.links.registry import LinkDefinition as LinkDefinition
from imuscope.server.links.registry import link_kinds as link_kinds
from imuscope.server.links.registry import register_link as register_link
from imuscope.server.links.source_url import SourceUrl as SourceUrl
from imuscope.server.services.extension import Extension as Extension
from imuscope.server.services.extension import ExtensionCommand as ExtensionCommand
from imuscope.server.services.extension import FileOutput as FileOutput
from imuscope.server.services.parts import ServicePart as ServicePart
from imuscope.server.services.services import Services as Services
from imuscope.server.settings.extension_settings import ExtensionSettings as ExtensionSettings
