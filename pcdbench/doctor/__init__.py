"""What an issue report needs to say: the installation, the machine, and whether every dependency works here."""
