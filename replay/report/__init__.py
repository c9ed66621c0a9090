"""What people read: explanations with frames, evidence folders, the HTML report."""

from replay.report.html import write_report

__all__ = ["write_report"]
