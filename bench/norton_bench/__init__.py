"""The experiment: control, guard, procedures, identification, recording, report."""
