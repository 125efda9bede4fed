"""Teams: craft that inspect a target together, each a row of a batch."""
