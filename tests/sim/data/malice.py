"""Pickles that would run code, fill the memory or never end, for tests of readers.

Written instruction by instruction where `pickle` would not write them. The table that
says what each instruction is stands in `pickletools` of Python's library.
"""

import pickle
import struct
from collections.abc import Callable
from typing import Any

PROTO, STOP, MARK = b"\x80\x04", b".", b"("
MUCH = 1 << 17  # repetitions: enough to exhaust what is not bounded, quick to write


def called(module: str, name: str, *arguments: Any) -> bytes:
    """Returns a pickle that calls a function when it is loaded by `pickle`."""
    body = pickle.dumps(arguments, protocol=2)[2:-1]
    return PROTO + f"c{module}\n{name}\n".encode() + body + b"R" + STOP


def named(module: str, name: str) -> bytes:
    """Returns a pickle of a function or class."""
    return PROTO + f"c{module}\n{name}\n".encode() + STOP


def calls() -> dict[str, bytes]:
    """Returns pickles that reach for code, by the name that they reach for."""
    command = "echo caught"
    return {
        "os.system": called("os", "system", command),
        "posix.system": called("posix", "system", command),
        "nt.system": called("nt", "system", command),
        "subprocess.Popen": called("subprocess", "Popen", command),
        "builtins.eval": called("builtins", "eval", "1/0"),
        "builtins.exec": called("__builtin__", "exec", "1/0"),
        "builtins.getattr": called("builtins", "getattr", 1, "real"),
        "builtins.__import__": called("builtins", "__import__", "os"),
        "importlib.import_module": called("importlib", "import_module", "os"),
        "copyreg._reconstructor": called("copyreg", "_reconstructor", 1, 2, 3),
        "functools.partial": called("functools", "partial", print),
        "operator.attrgetter": called("operator", "attrgetter", "real"),
        "pickle.loads": called("pickle", "loads", b"N."),
        "numpy.load": called("numpy", "load", "x", None, True),
        "numpy.core.multiarray.fromfile": called("numpy.core.multiarray", "fromfile"),
        "numpy.memmap": called("numpy", "memmap", "/etc/passwd"),
        "numpy.lib.npyio.NpzFile": named("numpy.lib.npyio", "NpzFile"),
        "ctypes.CDLL": named("ctypes", "CDLL"),
        "collections.OrderedDict.popitem": named("collections", "OrderedDict.popitem"),
        "metadrive.engine.core": named("metadrive.engine", "core"),
    }


def array(shape: Any, code: str, data: Any, *, fortran: Any = False) -> bytes:
    """Returns the instructions of an array as NumPy writes them, of any values."""

    def plain(value: Any) -> bytes:
        return pickle.dumps(value, protocol=2)[2:-1]

    dtype = b"cnumpy\ndtype\n" + plain((code, False, True)) + b"R"
    dtype += plain((3, "<", None, None, None, -1, -1, 0)) + b"b"
    begun = b"cnumpy.core.multiarray\n_reconstruct\n"
    begun += MARK + b"cnumpy\nndarray\n" + plain((0,)) + b"C\x01btR"
    content = data if isinstance(data, Instructions) else plain_bytes(data)
    state = MARK + b"K\x01" + plain(shape) + dtype + plain(fortran) + content + b"t"
    return begun + state + b"b"


class Instructions(bytes):
    """Bytes to be followed rather than held."""


def plain_bytes(data: bytes) -> bytes:
    """Returns the instruction that holds bytes."""
    return b"B" + struct.pack("<I", len(data)) + data


def tricks() -> dict[str, bytes]:
    """Returns pickles whose arrays are not what they say."""
    huge = 1 << 40
    arrays = {
        "a shape beyond the bytes": array((1 << 20,), "f8", bytes(8)),
        "an enormous shape": array((huge, huge), "f8", bytes(8)),
        "an enormous shape of nothing": array((huge, 0, huge), "f8", b""),
        "a negative shape": array((-1, -8), "f8", bytes(64)),
        "a shape of fractions": array((1.0,), "f8", bytes(8)),
        "a shape of many axes": array((1,) * 40, "f8", bytes(8)),
        "a shape that is nested": array(([8],), "f8", bytes(8)),
        "objects as bytes": array((2,), "O8", bytes(16)),
        "objects of another number": array((9,), "O8", Instructions(b"]")),
        "objects of two axes": array((0, 9), "O8", Instructions(b"]")),
        "void": array((1,), "V8", bytes(8)),
        "dates": array((1,), "M8", bytes(8)),
        "complex": array((1,), "c16", bytes(16)),
        "long floats": array((1,), "f16", bytes(16)),
        "a code of code": array((1,), "f8,O8", bytes(16)),
        "an enormous text": array((1,), "U99999999", bytes(8)),
        "no characters": array((1,), "U1", b"\xff" * 4),
        "no booleans": array((8,), "b1", b"\x02" * 8),
        "no bytes": array((8,), "u1", Instructions(b"X\x08\0\0\0abcdefgh")),
        "a list of itself": array((1,), "O8", Instructions(b"]q\x00h\x00a")),
        "an array that holds itself": b"cnumpy.core.multiarray\n_reconstruct\n)Rq\x00"
        + MARK
        + b"K\x01K\x01\x85cnumpy\ndtype\nX\x02\0\0\0O8\x85R\x89]h\x00atb",
    }
    return {name: PROTO + body + STOP for name, body in arrays.items()} | {
        "an array that is never ended": PROTO
        + b"cnumpy.core.multiarray\n_reconstruct\n)R"
        + STOP,
        "a dtype as a value": PROTO + b"cnumpy\ndtype\nX\x02\0\0\0f8\x85R" + STOP,
        "fields": PROTO
        + b"cnumpy\ndtype\nX\x02\0\0\0f8\x85R(K\x03X\x01\0\0\0<N)}NNNtb"
        + STOP,
    }


def forbidden() -> dict[str, bytes]:
    """Returns pickles with instructions that plain data do not need."""
    instructions = {
        "EXT1": b"\x82\x01",
        "EXT2": b"\x83\x01\x00",
        "EXT4": b"\x84\x01\x00\x00\x00",
        "PERSID": b"Pid\n",
        "BINPERSID": b"NQ",
        "INST": b"(ios\nsystem\n",
        "OBJ": b"(cbuiltins\nint\no",
        "NEWOBJ_EX": b"cbuiltins\nint\n)}\x92",
        "NEWOBJ of a factory": b"cbuiltins\nint\n)\x81",
        "NEXT_BUFFER": b"\x97",
        "READONLY_BUFFER": b"N\x98",
        "DUP": b"]2",
        "GET": b"]p0\ng0\n",
        "REDUCE of a number": b"K\x01)R",
        "REDUCE without arguments": b"cnumpy\ndtype\nNR",
        "BUILD of a number": b"K\x01}b",
        "BUILD of a class": b"cbuiltins\nint\n}b",
        "a class": b"cbuiltins\nint\n",
        "a protocol to come": b"\x80\x09N",
    }
    return {name: PROTO + body + STOP for name, body in instructions.items()}


def bombs() -> dict[str, bytes]:
    """Returns pickles that ask for more memory or time than there is."""
    doubled = b""
    for level in range(60):
        doubled += b"]q" + bytes([level + 1]) + b"(" + b"h%c" % level * 10 + b"e"
    shared = b"]q\x00(" + b"K\x01" * 1000 + b"e0](" + b"h\x00" * MUCH + b"e"
    shared_array = array((1 << 16,), "f8", bytes(1 << 19)) + b"q\x000"
    bodies = {
        "an index of the memo": b"]r\xff\xff\xff\xff",
        "many indices of the memo": b"".join(
            b"]r" + struct.pack("<I", (i * 0x9E3779B1) & 0xFFFFFFFF) + b"0"
            for i in range(MUCH // 16)
        )
        + b"N",
        "a frame": b"\x95" + b"\xff" * 8 + b"N",
        "a text": b"X\xff\xff\xff\xff",
        "a long text": b"\x8d" + struct.pack("<Q", 1 << 62),
        "bytes": b"\x8e" + struct.pack("<Q", 1 << 62),
        "a byte array": b"\x96" + struct.pack("<Q", 1 << 62),
        "an integer": b"\x8b\xff\xff\xff\x7f",
        "a long integer": b"\x8a\xff" + b"\x7f" * 255,
        "lists in lists": b"]" * MUCH + b"a" * (MUCH - 1),
        "tuples in tuples": b")" + b"\x85" * MUCH,
        "deep tuples as keys": b"})" + b"\x85" * MUCH + b"Ns",
        "deep tuples as a dtype": b"cnumpy\ndtype\n)" + b"\x85" * MUCH + b"\x85R",
        "deep tuples as a name": b")" + b"\x85" * MUCH + b"X\x01\0\0\0a\x93",
        "deep tuples as an order": b"cnumpy\ndtype\nX\x02\0\0\0f8\x85R(K\x03)"
        + b"\x85" * MUCH
        + b"NNNtb",
        "marks": b"(" * MUCH + b"t" * MUCH,
        "laughs": b"]q\x00K\x01a0" + doubled,
        "a list many times": shared,
        "an array many times": shared_array + b"](" + b"h\x00" * MUCH + b"e",
        "a list in itself": b"]q\x00h\x00a",
        "a dictionary in itself": b"}q\x00K\x01h\x00s",
        "bytes decoded many times": b"X\x00\x00\x08\x00"
        + b"a" * (1 << 19)
        + b"q\x000"
        + b"c_codecs\nencode\nh\x00X\x06\0\0\0latin1\x86R0" * (MUCH // 16)
        + b"N",
        "instructions": b"N0" * (1 << 21),
        "empty lists": b"(" + b"]" * (1 << 19) + b"l",
        "nothing at all": b"",
        "names without end": b"c" + b"a" * MUCH,
    }
    return {name: PROTO + body + STOP for name, body in bodies.items()}


def as_tracks(body: bytes) -> bytes:
    """Returns a pickle of a scenario whose tracks are what a pickle holds."""
    inner = body[len(PROTO) : -len(STOP)]
    key = b"X\x06\0\0\0tracks"
    rest = pickle.dumps({"a": 1}, protocol=2)[2:-1]
    others = b"X\x0c\0\0\0map_features" + rest + b"X\x08\0\0\0metadata" + rest
    return PROTO + b"}(" + others + key + inner + b"u" + STOP


def everything() -> dict[str, bytes]:
    """Returns all of them, and the short ones as the tracks of a scenario as well."""
    kinds: list[Callable[[], dict[str, bytes]]] = [calls, tricks, forbidden, bombs]
    alone = {name: body for kind in kinds for name, body in kind().items()}
    within = {
        f"{name}, as tracks": as_tracks(body)
        for name, body in alone.items()
        if len(body) < MUCH
    }
    return alone | within
