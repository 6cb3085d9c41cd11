"""Gate for motions that others make: proved with the stop behind them, before they are sent."""
