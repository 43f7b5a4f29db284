"""Plan to Learn: a robot plans which skills are worth learning, learns them, and shows that it paid."""
