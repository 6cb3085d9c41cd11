"""Traces of requests by OpenTelemetry: their way through queue, worker and stages.

Nothing of OpenTelemetry is imported unless traces are asked for: `service.tracing.extra` opens
them.
"""
