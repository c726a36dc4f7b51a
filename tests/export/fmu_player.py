"""Plays an FMU as a simulation program does: unpacks it, loads its binary and calls the functions
of the standard.
"""

import ctypes
import sys
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

PLATFORM = "x86_64-windows" if sys.platform == "win32" else "x86_64-linux"
ENDING = ".dll" if sys.platform == "win32" else ".so"
OK = 0
ERROR = 3

DOUBLE = ctypes.c_double
FLAG = ctypes.c_bool
SIZE = ctypes.c_size_t
POINTER = ctypes.c_void_p
LOG = ctypes.CFUNCTYPE(None, POINTER, ctypes.c_int, ctypes.c_char_p, ctypes.c_char_p)


class Fmu:
    """An unpacked FMU; `variables` are the attributes of its variables by name."""

    def __init__(self, path: Path, folder: Path) -> None:
        with zipfile.ZipFile(path) as archive:
            archive.extractall(folder)
        self.folder = folder
        root = ElementTree.parse(folder / "modelDescription.xml").getroot()
        self.token = root.attrib["instantiationToken"]
        self.variables = {
            variable.attrib["name"]: variable.attrib for variable in root.find("ModelVariables")
        }
        name = root.find("CoSimulation").attrib["modelIdentifier"]
        self.library = ctypes.CDLL(str(folder / "binaries" / PLATFORM / (name + ENDING)))
        self.library.fmi3InstantiateCoSimulation.restype = POINTER
        self.library.fmi3GetVersion.restype = ctypes.c_char_p

    def names(self, causality: str) -> list[str]:
        return [
            name
            for name, keys in self.variables.items()
            if keys.get("causality", "local") == causality
        ]

    def instance(self, token: str | None = None) -> "Instance":
        return Instance(self, token or self.token)


class Instance:
    """One model of an FMU. `messages` are what it logged."""

    def __init__(self, fmu: Fmu, token: str) -> None:
        self.fmu = fmu
        self.messages: list[str] = []
        # Kept, because the library calls it later.
        self._log = LOG(lambda *message: self.messages.append(message[-1].decode()))
        self.model = POINTER(
            fmu.library.fmi3InstantiateCoSimulation(
                b"leg",
                token.encode(),
                None,
                FLAG(False),
                FLAG(False),
                FLAG(False),
                FLAG(False),
                None,
                SIZE(0),
                None,
                self._log,
                None,
            )
        )

    def call(self, name: str, *arguments: object) -> int:
        return int(getattr(self.fmu.library, name)(self.model, *arguments))

    def set(self, **values: float) -> int:
        references = [int(self.fmu.variables[name]["valueReference"]) for name in values]
        count = len(values)
        return self.call(
            "fmi3SetFloat64",
            (ctypes.c_uint32 * count)(*references),
            SIZE(count),
            (DOUBLE * count)(*values.values()),
            SIZE(count),
        )

    def get(self, *names: str) -> list[float]:
        references = [int(self.fmu.variables[name]["valueReference"]) for name in names]
        count = len(names)
        values = (DOUBLE * count)()
        status = self.call(
            "fmi3GetFloat64",
            (ctypes.c_uint32 * count)(*references),
            SIZE(count),
            values,
            SIZE(count),
        )
        assert status == OK, self.messages
        return list(values)

    def initialize(self, tolerance: float | None = None, start_s: float = 0.0) -> int:
        entered = self.call(
            "fmi3EnterInitializationMode",
            FLAG(tolerance is not None),
            DOUBLE(tolerance or 0.0),
            DOUBLE(start_s),
            FLAG(False),
            DOUBLE(0.0),
        )
        return entered or self.call("fmi3ExitInitializationMode")

    def step(self, at_s: float, step_s: float) -> int:
        flags = [FLAG(), FLAG(), FLAG()]
        return self.call(
            "fmi3DoStep",
            DOUBLE(at_s),
            DOUBLE(step_s),
            FLAG(True),
            *map(ctypes.byref, flags),
            ctypes.byref(DOUBLE()),
        )

    def play(self, inputs, step_s: float, begin: int = 0) -> np.ndarray:
        """Outputs (k, outputs) after steps with these inputs (k,), from step `begin` on."""
        (name,) = self.fmu.names("input")
        outputs = self.fmu.names("output")
        rows = []
        for number, value in enumerate(inputs, start=begin):
            assert self.set(**{name: value}) == OK
            assert self.step(number * step_s, step_s) == OK, self.messages
            rows.append(self.get(*outputs))
        return np.array(rows)

    def reset(self) -> None:
        assert self.call("fmi3Reset") == OK

    def free(self) -> None:
        self.fmu.library.fmi3FreeInstance(self.model)
