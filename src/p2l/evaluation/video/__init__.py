"""Films of nominal runs, failures and recoveries; the only room of evaluation that draws a simulated scene."""
