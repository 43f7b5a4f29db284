"""Chapter 3's task distributions: abstract simulations in which skills are learnt and tried on other tasks."""
