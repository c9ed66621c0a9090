"""The one read layer and the one write layer over MCAP."""

from recorders.log.model import Attachment, ChannelInfo, LogHeader, Message, Order, Schema
from recorders.log.reader import LogReader
from recorders.log.writer import LogWriter

__all__ = [
    "Attachment",
    "ChannelInfo",
    "LogHeader",
    "LogReader",
    "LogWriter",
    "Message",
    "Order",
    "Schema",
]
