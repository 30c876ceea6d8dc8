"""Specification of a policy's observation and timing."""
