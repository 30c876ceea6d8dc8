"""Stand-in for Unitree's SDK: the classes that the example uses, over datagrams on this machine."""
