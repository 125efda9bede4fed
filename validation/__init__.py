"""Where claims become reports: every study is a list of checks, each with a tolerance and its reason."""
