"""Which OpenGL the machine has, asked in C, since PyOpenGL decides only once in a process.

what         asks                                         if the probe fails
has_egl      libEGL.so.1, for a device without a screen   OSMesa draws, if it is installed
has_osmesa   libOSMesa                                    cameras fail, and say what to install
"""

from __future__ import annotations

import ctypes


def has_osmesa() -> bool:
    for name in ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so"):
        try:
            ctypes.CDLL(name)
        except OSError:
            continue
        return True
    return False


def has_egl() -> bool:
    """Whether EGL has a device that can be used without a screen."""
    try:
        egl = ctypes.CDLL("libEGL.so.1")
    except OSError:
        return False
    egl.eglGetProcAddress.restype = ctypes.c_void_p
    query, display = (egl.eglGetProcAddress(name) for name in (b"eglQueryDevicesEXT", b"eglGetPlatformDisplayEXT"))
    if not query or not display:
        return False
    devices, count = (ctypes.c_void_p * 10)(), ctypes.c_int()
    ctypes.CFUNCTYPE(ctypes.c_uint, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)(query)(
        len(devices), ctypes.addressof(devices), ctypes.addressof(count)
    )
    shown = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_uint, ctypes.c_void_p, ctypes.c_void_p)(display)
    egl.eglInitialize.argtypes = [ctypes.c_void_p] * 3
    platform_device = 0x313F
    return any(
        found and egl.eglInitialize(found, None, None)
        for found in (shown(platform_device, device, None) for device in devices[: count.value])
    )
