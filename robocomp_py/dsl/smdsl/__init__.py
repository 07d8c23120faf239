"""SMDSL: state machines. SCXML, the W3C's form of them, is read into the same model."""
