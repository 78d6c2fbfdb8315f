"""A scanner, measured on frames of an eye at rest.

Pure: no file, no clock, no socket. Imports `lab`, `wall`, `mechanics`, `records` and
`base`.

Public:
    measured_scanner: `MeasuredRange`, `MeasuredScanner`, `drawn_alike`,
        `histogram_overlap`, `measure_scanner`, `oct_of`, `study_text`
    scanner_display: `ImagedEye`
"""
