"""Task distributions: each world is one file, one YAML and one registry line."""

import logging

# robosuite tells of optional packages whenever it is imported, and sets its logger's level itself.
logging.getLogger("robosuite_logs").addFilter(lambda record: record.levelno >= logging.ERROR)
