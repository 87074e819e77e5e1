"""A page in the Chromium of Qt, without a screen: ``python web_engine.py PDF``. What the page prints goes to the file PDF.

The first line of its output is the address at which it takes commands of the DevTools protocol. Qt takes size and margins of the
paper from here, not from the style of the page: upright A4, with the margins of a report.
"""

import os
import socket
import sys

with socket.socket() as free:
    free.bind(("127.0.0.1", 0))
    SERVER = f"127.0.0.1:{free.getsockname()[1]}"
os.environ |= {"QT_QPA_PLATFORM": "offscreen", "QTWEBENGINE_DISABLE_SANDBOX": "1", "QTWEBENGINE_REMOTE_DEBUGGING": SERVER}

from PyQt6.QtCore import QMarginsF, QUrl
from PyQt6.QtGui import QPageLayout, QPageSize
from PyQt6.QtWebEngineWidgets import QWebEngineView
from PyQt6.QtWidgets import QApplication

MARGINS = QMarginsF(12.0, 12.0, 12.0, 14.0)  # [mm] left, top, right, bottom: those of @page in style.css.jinja
PAPER = QPageLayout(QPageSize(QPageSize.PageSizeId.A4), QPageLayout.Orientation.Portrait, MARGINS, QPageLayout.Unit.Millimeter)


def main(printed: str) -> int:
    """Show a page until the process is ended."""
    application = QApplication(sys.argv[:1])
    view = QWebEngineView()
    page = view.page()
    assert page is not None
    view.printRequested.connect(lambda: page.printToPdf(printed, PAPER))
    view.setUrl(QUrl("about:blank"))
    view.show()
    print(f"ws://{SERVER}/devtools/page/{page.devToolsId()}", flush=True)
    return application.exec()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
