"""The thesis's programs in Pyomo, solved by HiGHS (thesis, equations 3.1 to 3.3)."""
