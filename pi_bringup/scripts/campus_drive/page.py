"""The report of `make demo` as one HTML page that needs no other file."""

import base64
import html

from . import demo, report

STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 2em auto; max-width: 72em; padding: 0 1em; color: #1c2430; }
h1 { font-size: 1.6em; margin-bottom: 0; } h2 { font-size: 1.15em; margin-top: 2em; }
.verdict { font-size: 1.15em; padding: .6em .9em; border-left: .4em solid #1f8a70; background: #eef6f3; }
.verdict.bad { border-color: #bd4b4b; background: #f9eeee; }
table { border-collapse: collapse; } td, th { padding: .2em .9em .2em 0; text-align: left; vertical-align: top; }
tr + tr td { border-top: 1px solid #dde3ea; } td.number { text-align: right; white-space: nowrap; }
td.missed { color: #bd4b4b; font-weight: 600; } img { max-width: 100%; } figcaption { color: #5b6673; }
pre { background: #f4f6f8; padding: .8em; overflow: auto; }
@media (prefers-color-scheme: dark) { body { background: #14181d; color: #dfe5ec; } .verdict { background: #1b2a26; }
.verdict.bad { background: #2e1d1d; } tr + tr td { border-color: #333b45; } pre { background: #1d232a; }
img { background: #fff; } }
"""


def rows_of(rows):
    """A table of texts, the header first. What misses its bar ends with an exclamation mark."""
    lines = ["<tr>%s</tr>" % "".join("<th>%s</th>" % html.escape(text) for text in rows[0])]
    for row in rows[1:]:
        cells = []
        for index, text in enumerate(row):
            kind = "" if index < 2 else " class='number missed'" if text.endswith(" !") else " class='number'"
            cells.append("<td%s>%s</td>" % (kind, html.escape(text)))
        lines.append("<tr>%s</tr>" % "".join(cells))
    return "<table>%s</table>" % "\n".join(lines)


def picture(path, caption):
    content = base64.b64encode(path.read_bytes()).decode("ascii")
    kind = "jpeg" if path.suffix == ".jpg" else "png"
    return "<figure><img alt='%s' src='data:image/%s;base64,%s'><figcaption>%s</figcaption></figure>" % (
        html.escape(caption, quote=True), kind, content, html.escape(caption))


def document(title, subtitle, verdict, is_good, parts, path):
    """@param parts  of HTML. @return path. @throws OSError"""
    lines = ["<!doctype html><html lang='en'><meta charset='utf-8'><title>%s</title>" % html.escape(title),
             "<meta name='viewport' content='width=device-width'><style>%s</style>" % STYLE,
             "<h1>%s</h1><p>%s</p>" % (html.escape(title), html.escape(subtitle)),
             "<p class='verdict%s'>%s</p>" % ("" if is_good else " bad", html.escape(verdict)), *parts]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def happened(tree):
    return "<h2>What happened</h2><pre>%s</pre>" % html.escape("\n".join(report.happened(tree)))


def write(tree, pictures, path):
    """@param pictures  [(path, caption)]; those that are not there are left out. @return path. @throws OSError"""
    drive = tree["drive"]
    parts = [rows_of(demo.first_rows(tree))]
    parts += ["<p>%s</p>" % html.escape(text) for text in demo.notes(tree)]
    parts += ["<h2>Pictures</h2>"] + [picture(*one) for one in pictures if one[0].is_file()]
    parts += [happened(drive)]
    return document(tree["scenario"], "%.0f m in %.0f s, seed %d" % (drive["distance_m"], drive["seconds"],
                                                                     tree["seed"]),
                    demo.verdict(tree), tree["passed"], parts, path)
