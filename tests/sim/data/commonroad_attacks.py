"""Makes files of CommonRoad that hurt: entities, and elements without end."""

import gzip
from xml.etree import ElementTree

from tests.sim.data import commonroad_files, files

WANTED = files.scenario(num_steps=13)
OPENED = '<commonRoad benchmarkID="a" commonRoadVersion="2020a" timeStepSize="0.1">'
CLOSED = "</commonRoad>"
DEEP = 1 << 17  # elements in one another


def text(version: str = "2020a") -> str:
    """Returns the document of a scenario."""
    return ElementTree.tostring(
        commonroad_files.document(WANTED, version), encoding="unicode"
    )


def typed(declared: str, content: str = "&a;") -> str:
    """Returns a document with a document type, and with content."""
    return f"<!DOCTYPE commonRoad {declared}>{OPENED}{content}{CLOSED}"


def entities() -> dict[str, str]:
    """Returns documents whose entities grow, or lie elsewhere."""
    laughs = '<!ENTITY a "ha">'
    for i in range(20):
        name, before = "abcdefghijklmnopqrstu"[i + 1], "abcdefghijklmnopqrstu"[i]
        laughs += f'<!ENTITY {name} "{f"&{before};" * 10}">'
    parts = '<!ENTITY % a "x"><!ENTITY % b "%a;%a;%a;%a;%a;%a;%a;%a;"> %b;'
    return {
        "billion laughs": typed(f"[{laughs}]", "&u;"),
        "billion laughs in an attribute": typed(f"[{laughs}]", '<lanelet id="&u;"/>'),
        "quadratic": typed(f'[<!ENTITY a "{"a" * 10**5}">]', "&a;" * 10**5),
        "in itself": typed('[<!ENTITY a "&b;"><!ENTITY b "&a;">]'),
        "parameters": typed(f"[{parts}]"),
        "a file": typed('[<!ENTITY a SYSTEM "file:///etc/passwd">]'),
        "a device": typed('[<!ENTITY a SYSTEM "file:///dev/zero">]'),
        "an address": typed('[<!ENTITY a SYSTEM "http://127.0.0.1:9/a">]'),
        "a public one": typed('[<!ENTITY a PUBLIC "a" "file:///etc/passwd">]'),
        "another type": typed('SYSTEM "file:///etc/passwd"', ""),
        "a parameter elsewhere": typed('[<!ENTITY % a SYSTEM "file:///a"> %a;]', ""),
        "a notation": typed('[<!NOTATION a SYSTEM "file:///a">]', ""),
        "values by default": typed('[<!ATTLIST commonRoad a CDATA "b">]', ""),
        "undeclared": OPENED + "&a;" + CLOSED,
        "a character that is none": OPENED + "&#xFFFFFFFF;" + CLOSED,
        "included": OPENED
        + '<a:include xmlns:a="http://www.w3.org/2001/XInclude" href="/etc/passwd"/>'
        + CLOSED,
        "a style": f'<?xml-stylesheet href="file:///etc/passwd"?>{text()}',
    }


def large() -> dict[str, str]:
    """Returns documents that are deep, wide or long."""

    def holding(content: str) -> str:
        return OPENED + content + CLOSED

    return {
        "deep": OPENED + "<a>" * DEEP,
        "deep and closed": holding("<a>" * DEEP + "</a>" * DEEP),
        "deep lanelets": holding('<lanelet id="1">' * DEEP + "</lanelet>" * DEEP),
        "many elements": holding("<a b=''/>" * (1 << 20)),
        "elements that fit": holding("<a/>" * 990_000),
        "many attributes": holding(
            "<a " + " ".join(f'a{i}="1"' for i in range(10**5)) + "/>"
        ),
        "a long value": OPENED.replace('"a"', f'"{"a" * (1 << 24)}"') + CLOSED,
        "a long name": holding(f"<{'a' * (1 << 24)}/>"),
        "a long text": holding("a" * (1 << 25)),
        "a text that is too long": holding("a" * (1 << 26)),
        "a long comment": "<!--" + "a" * (1 << 24) + "-->" + text(),
        "many comments": holding("<!---->" * 10**6),
        "many instructions": holding("<?a?>" * 10**6),
        "many sections": holding("<![CDATA[]]>" * 10**5),
        "sections never closed": OPENED + "<![CDATA[" * 10**5,
        "tags never closed": OPENED + "<a b='" * 10**5,
        "spaces": " " * (1 << 24) + text(),
    }


def numbers() -> dict[str, str]:
    """Returns documents whose numbers are none, or too large."""
    told = text()
    lanelet = '<lanelet id="11">'
    exact, step = "<time><exact>12</exact></time>", "<time><exact>{}</exact></time>"
    found = {
        f"a time of {value:.20}": told.replace(exact, step.format(value))
        for value in (
            *(
                "nan",
                "inf",
                "-inf",
                "1e308",
                "-1e308",
                "1e18",
                "99999",
                "1_2",
                "\u0663",
                "",
            ),
            *("0x1p9", "9" * 10**6, "." + "0" * 10**6 + "1"),
        )
    }
    for value in (
        "",
        "x",
        "1.5",
        "1e3",
        str(2**63),
        "-1",
        "9" * 10**6,
        "\u0661",
        "1_1",
    ):
        found[f"an id of {value:.20}"] = told.replace(
            lanelet, lanelet.replace("11", value)
        )
        found[f"a step of {value:.20} s"] = told.replace(
            'timeStepSize="0.1"', f'timeStepSize="{value}"'
        )
    for tag in ("x", "y", "length", "width", "intervalEnd", "duration", "timeOffset"):
        for value in ("nan", "inf", "1e308", "-1e308", "1e-308"):
            head, opening, rest = told.partition(f"<{tag}>")
            found[f"{tag} of {value}"] = (
                head + opening + value + rest[rest.index("<") :]
            )
            found[f"each {tag} of {value}"] = told.replace(
                f"<{tag}>", f"<{tag}>{value}</{tag}><{tag}>"
            )
    return found


def logs() -> dict[str, str]:
    """Returns logs of absurdly many states, and maps of as many lanes."""

    def state(step: int, tag: str = "state") -> str:
        return (
            f"<{tag}><position><point><x>{step}</x><y>0</y></point></position>"
            "<orientation><exact>0</exact></orientation>"
            f"<time><exact>{step}</exact></time></{tag}>"
        )

    def obstacle(name: int, last: int, role: str = "dynamic") -> str:
        return (
            f'<{role}Obstacle id="{name}"><type>car</type><shape><circle>'
            f"<radius>1</radius></circle></shape>{state(0, 'initialState')}"
            f"<trajectory>{state(last)}</trajectory></{role}Obstacle>"
        )

    def lane(name: int, content: str, y: int = 0) -> str:
        left, right = (
            f"<{side}Bound><point><x>0</x><y>{y + across}</y></point>"
            f"<point><x>9</x><y>{y + across}</y></point></{side}Bound>"
            for side, across in (("left", 3), ("right", 0))
        )
        return f'<lanelet id="{name}">{left}{right}{content}</lanelet>'

    def log(content: str, last: int = 12, opened: str = OPENED) -> str:
        """Returns a document with a log of two cars, of which one stands."""
        ego = obstacle(2, 0, "static")
        return opened + lane(1, "") + content + obstacle(1, last) + ego + CLOSED

    def wide(number: int, content: str, others: str = "") -> str:
        return log("".join(lane(i, content, 4 * i) for i in range(number)) + others)

    cycle = "<cycleElement><duration>1</duration><color>red</color></cycleElement>"
    light = f'<trafficLight id="5"><cycle>{cycle * 50_000}</cycle></trafficLight>'
    sign = (
        '<trafficSign id="5"><trafficSignElement><trafficSignID>206</trafficSignID>'
        "</trafficSignElement></trafficSign>"
    )
    many = "".join(obstacle(i, 99) for i in range(3, 1500))
    return {
        "steps without end": log("", 10**18),
        "the most steps": log("", 500_000),
        "long steps of many": log(many, opened=OPENED.replace("0.1", "10")),
        "many who are the same": log(obstacle(1, 12) * 1000),
        "a light for all": wide(300, '<trafficLightRef ref="5"/>', light),
        "a sign for all": wide(600, '<trafficSignRef ref="5"/>', sign),
        "lanes at one place": log(lane(1, "") * 500),
        "lanes that are all crossed": wide(
            2000, "<laneletType>crosswalk</laneletType>"
        ),
        "references": wide(9, '<successor ref="1"/>' * 10_000),
        "references to others": wide(
            1, "".join(f'<successor ref="{i}"/>' for i in range(10**5))
        ),
        "a stop at many places": wide(
            1, "<stopLine>" + "<point><x>1</x><y>2</y></point>" * 50_000 + "</stopLine>"
        ),
    }


def encodings() -> dict[str, bytes]:
    """Returns texts that are no UTF-8, or say that they are something else."""
    told = text()
    plain, older = told.encode(), text("2018b").encode()
    head = "<?xml version='1.0' encoding='{}'?>"
    return {
        "the older version": older,
        "the older version, cut": older[:-100],
        "bytes that are no UTF-8": plain.replace(b"car", b"\xff\xc0\xaf"),
        "half a character": plain.replace(b"car", b"\xe2\x82"),
        "nothing between": plain.replace(b"car", b"c\x00r"),
        "UTF-16": told.encode("utf-16"),
        "UTF-16 of UTF-8": head.format("utf-16").encode() + plain,
        **{
            f"an encoding of {name:.20}": head.format(name).encode() + plain
            for name in (
                *("utf-7", "rot13", "zlib", "idna", "punycode", "unicode_escape"),
                *("undefined", "cp037", "ucs-4", "base64", "x" * 1000, "a\x00b"),
            )
        },
        "zeros": gzip.compress(b"<commonRoad>", mtime=0)
        + gzip.compress(bytes(1 << 20), mtime=0) * 200,
        "spaces": gzip.compress(b" " * 1000 + b"<commonRoad>" + b" " * (20 << 20)),
    }


def everything() -> dict[str, bytes]:
    """Returns all of them."""
    made = entities() | large() | numbers() | logs()
    return {name: content.encode() for name, content in made.items()} | encodings()
