"""SimpleFOC boards, spoken to through the library's Commander."""
