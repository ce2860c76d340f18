"""What others recorded: ArduPilot's logs and videos."""
