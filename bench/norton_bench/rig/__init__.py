"""What a rig file says, validated and in SI."""
