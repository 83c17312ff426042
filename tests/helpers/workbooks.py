"""Workbooks of a spreadsheet, written by a plain zip of their parts (ECMA-376)."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping, Sequence

SPACE = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
LINKS = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
PACKAGE = "http://schemas.openxmlformats.org/package/2006"


def workbook(sheets: Mapping[str, Sequence[Sequence[str | float]]]) -> bytes:
    """Bytes of an .xlsx with these sheets, cells row by row."""
    numbered = list(enumerate(sheets, start=1))
    books = "".join(f'<sheet name="{name}" sheetId="{k}" r:id="r{k}"/>' for k, name in numbered)
    links = "".join(
        f'<Relationship Id="r{k}" Type="{LINKS}/worksheet" Target="worksheets/sheet{k}.xml"/>' for k, _ in numbered
    )
    parts = {
        "[Content_Types].xml": f'<Types xmlns="{PACKAGE}/content-types">'
        '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
        '<Default Extension="xml" '
        'ContentType="application/vnd.openxmlformats-officedocument.spreadsheetml.sheet.main+xml"/>'
        "</Types>",
        "_rels/.rels": f'<Relationships xmlns="{PACKAGE}/relationships"><Relationship Id="r1" '
        f'Type="{LINKS}/officeDocument" Target="xl/workbook.xml"/></Relationships>',
        "xl/workbook.xml": f'<workbook xmlns="{SPACE}" xmlns:r="{LINKS}"><sheets>{books}</sheets></workbook>',
        "xl/_rels/workbook.xml.rels": f'<Relationships xmlns="{PACKAGE}/relationships">{links}</Relationships>',
    }
    for k, name in numbered:
        rows = "".join(f'<row r="{r}">{_cells(row, r)}</row>' for r, row in enumerate(sheets[name], start=1))
        parts[f"xl/worksheets/sheet{k}.xml"] = f'<worksheet xmlns="{SPACE}"><sheetData>{rows}</sheetData></worksheet>'
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, text in parts.items():
            archive.writestr(name, f'<?xml version="1.0" encoding="UTF-8"?>{text}')
    return out.getvalue()


def _cells(row: Sequence[str | float], r: int) -> str:
    """The cells of row `r`, up to column Z."""
    out = ""
    for c, value in enumerate(row):
        at = f"{'ABCDEFGHIJKLMNOPQRSTUVWXYZ'[c]}{r}"
        text = f'<c r="{at}" t="inlineStr"><is><t>{value}</t></is></c>'
        out += text if isinstance(value, str) else f'<c r="{at}"><v>{value!r}</v></c>'
    return out
