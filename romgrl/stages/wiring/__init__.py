"""From a configuration and artifacts to the objects that a stage works with."""
