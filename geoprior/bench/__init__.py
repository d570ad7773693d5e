"""What is measured: functions that return plain numbers."""
